"""Symbols of units."""

from ifcopenshell.util.unit import get_measure_unit_type, prefix_symbols, unit_symbols

# Units of the SI; those of squares and cubes have a prefix of the length.
SI = {
    "AMPERE": "A", "BECQUEREL": "Bq", "CANDELA": "cd", "COULOMB": "C", "CUBIC_METRE": "m³",
    "DEGREE_CELSIUS": "°C", "FARAD": "F", "GRAM": "g", "GRAY": "Gy", "HENRY": "H", "HERTZ": "Hz",
    "JOULE": "J", "KELVIN": "K", "LUMEN": "lm", "LUX": "lx", "METRE": "m", "MOLE": "mol", "NEWTON": "N",
    "OHM": "Ω", "PASCAL": "Pa", "RADIAN": "rad", "SECOND": "s", "SIEMENS": "S", "SIEVERT": "Sv",
    "SQUARE_METRE": "m²", "STERADIAN": "sr", "TESLA": "T", "VOLT": "V", "WATT": "W", "WEBER": "Wb",
}
RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class Units:
    """The units of a model's measures."""

    def __init__(self, model):
        self.model = model
        self.of_project = {}
        for project in model.of_class("IfcProject")[:1]:
            for unit in project.UnitsInContext and project.UnitsInContext.Units or ():
                self.of_project[model.value(unit, "UnitType")] = self.symbol(unit)

    def of_measure(self, measure, unit):
        """The symbol of a measure's unit: `unit`, or else the project's; empty for a number without."""
        return self.symbol(unit) if unit else self.of_project.get(get_measure_unit_type(measure), "")

    def of_quantity(self, quantity):
        """The symbol of a quantity's unit."""
        kind = quantity.is_a().removeprefix("IfcQuantity")
        kind = "Mass" if kind == "Weight" else kind
        return self.of_measure(f"Ifc{kind}Measure", quantity.Unit)

    def symbol(self, unit):
        """The symbol of a unit."""
        if unit.is_a("IfcDerivedUnit"):
            return self.derived(unit)
        name = self.model.value(unit, "Name") or ""
        if unit.is_a("IfcSIUnit"):
            return prefix_symbols.get(unit.Prefix, "") + SI.get(name, name.lower())
        return unit_symbols.get(name.lower(), name)

    def derived(self, unit):
        """The symbol of a product of units."""
        above, below = [], []
        for element in unit.Elements:
            power = abs(element.Exponent)
            symbol = self.symbol(element.Unit) + (str(power).translate(RAISED) if power > 1 else "")
            (above if element.Exponent > 0 else below).append(symbol)
        over = "·".join(above) or "1"
        if not below:
            return over
        return f"{over}/{below[0]}" if len(below) == 1 else f"{over}/({'·'.join(below)})"
