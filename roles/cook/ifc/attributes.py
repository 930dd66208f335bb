"""The attributes that a file gives its products, as names and texts."""

import functools
import math

from units import Units

PLAIN = ("GlobalId", "Tag", "Description", "ObjectType", "LongName", "PredefinedType")
# The ways from a set of materials to its materials.
OF_MATERIALS = (
    "ForLayerSet", "ForProfileSet", "MaterialLayers", "MaterialProfiles", "MaterialConstituents", "Materials",
    "Material",
)
# Sets of properties that are remembered: many products share one.
REMEMBERED = 10_000


class Attributes:
    """The attributes of products. `unread` has the number of a product for each set that cannot be read."""

    def __init__(self, model):
        self.model = model
        self.units = Units(model)
        self.unread = []
        self.rows = functools.lru_cache(REMEMBERED)(self.rows)

    def of(self, entity):
        """The attributes of a product or a project."""
        value, values = self.model.value, self.model.values
        found = {"IFC class": entity.is_a()}
        for name in PLAIN:
            found[name] = text(value(entity, name))
        for name in ("Elevation", "RefElevation"):
            found[name] = with_unit(value(entity, name), self.units.of_measure("IfcLengthMeasure", None))
        for name in ("RefLatitude", "RefLongitude"):
            found[name] = degrees(values(entity, name))
        kind = self.type_of(entity)
        found["Type"] = text(kind and kind.Name)
        for name, texts in self.associated(entity, kind).items():
            found[name] = ", ".join(dict.fromkeys(filter(None, texts)))
        for definition in self.sets(entity, kind):
            try:
                found.update(self.rows(definition.id()))
            except (AttributeError, RuntimeError, SystemError, TypeError, ValueError):
                self.unread.append(entity.id())
        if entity.is_a("IfcProject"):
            found.update(self.place())
        return {name: value for name, value in found.items() if value}

    def type_of(self, entity):
        """The type of a product, if it has one."""
        typed = (*self.model.values(entity, "IsTypedBy"), *self.model.values(entity, "IsDefinedBy"))
        return next((one.RelatingType for one in typed if one.is_a("IfcRelDefinesByType")), None)

    def associated(self, entity, kind):
        """Names of materials, classes of other catalogues, and groups such as systems."""
        found = {"Material": [], "Classification": [], "Groups": []}
        for owner in filter(None, (entity, kind)):
            for one in self.model.values(owner, "HasAssociations"):
                if one.is_a("IfcRelAssociatesMaterial") and (owner == entity or not found["Material"]):
                    found["Material"] += self.materials(one.RelatingMaterial)
                if one.is_a("IfcRelAssociatesClassification"):
                    reference = one.RelatingClassification
                    names = ("Identification", "ItemReference", "Name")
                    words = [self.model.value(reference, name) for name in names]
                    found["Classification"].append(" ".join(filter(None, words)))
        for one in self.model.values(entity, "HasAssignments"):
            if one.is_a("IfcRelAssignsToGroup"):
                found["Groups"].append(one.RelatingGroup.Name)
        return found

    def materials(self, material):
        """The names of a material, or of those in a set."""
        if material is None:
            return []
        if material.is_a("IfcMaterial"):
            return [material.Name]
        inner = (one for way in OF_MATERIALS for one in self.model.values(material, way))
        return [name for one in inner for name in self.materials(one)]

    def sets(self, entity, kind):
        """Sets of properties and of quantities: the type's, and then its own, which count more."""
        yield from kind and kind.HasPropertySets or ()
        for one in self.model.values(entity, "IsDefinedBy"):
            if one.is_a("IfcRelDefinesByProperties"):
                definition = one.RelatingPropertyDefinition
                is_several = definition.is_a("IfcPropertySetDefinitionSet")
                yield from definition.wrappedValue if is_several else (definition,)

    def rows(self, number):
        """The names and texts of a set, called `SET.PROPERTY`."""
        definition = self.model.file.by_id(number)
        name = f"{definition.Name}." if definition.Name else ""
        if definition.is_a("IfcPropertySet"):
            parts = definition.HasProperties
        elif definition.is_a("IfcElementQuantity"):
            parts = definition.Quantities
        else:
            # Of a schema's own sets each property is an attribute, behind those that all sets have.
            return self.plain(definition, definition.is_a() + ".", 4)
        return dict(row for part in parts or () for row in self.row(name, part))

    def row(self, prefix, part):
        """Names and texts of a property or a quantity: several for one of several."""
        name = prefix + (part.Name or "")
        for several in ("HasProperties", "HasQuantities"):
            for inner in self.model.values(part, several):
                yield from self.row(name + ".", inner)
        if part.is_a("IfcPhysicalSimpleQuantity"):
            yield name, with_unit(part[3], self.units.of_quantity(part))
        elif part.is_a("IfcPropertyBoundedValue"):
            limits = [self.measure(part, value) for value in (part.LowerBoundValue, part.UpperBoundValue)]
            yield name, " to ".join(limits) if any(limits) else ""
        elif part.is_a("IfcPropertyTableValue"):
            pairs = zip(part.DefiningValues or (), part.DefinedValues or ())
            yield name, ", ".join(f"{text(one.wrappedValue)}: {text(two.wrappedValue)}" for one, two in pairs)
        elif part.is_a("IfcSimpleProperty"):
            ways = ("NominalValue", "EnumerationValues", "ListValues")
            values = [value for way in ways for value in self.model.values(part, way)]
            yield name, ", ".join(self.measure(part, value) for value in values)

    def measure(self, part, value):
        """A value of a property, with its unit."""
        if value is None:
            return ""
        unit = self.model.value(part, "Unit")
        return with_unit(value.wrappedValue, self.units.of_measure(value.is_a(), unit))

    def plain(self, entity, prefix, first=0):
        """An entity's attributes that are texts or numbers, from the one of number `first` on."""
        names = range(first, len(entity))
        return {prefix + entity.attribute_name(number): text(entity[number]) for number in names}

    def place(self):
        """Where on Earth the model's coordinates are, as its contexts say."""
        found = {}
        for context in self.model.of_class("IfcGeometricRepresentationContext"):
            for operation in self.model.values(context, "HasCoordinateOperation"):
                found.update(self.plain(operation, operation.is_a() + "."))
                found.update(self.plain(operation.TargetCRS, operation.TargetCRS.is_a() + "."))
            is_own = not context.is_a("IfcGeometricRepresentationSubContext")
            if is_own and context.TrueNorth:
                x, y = context.TrueNorth.DirectionRatios[:2]
                found["TrueNorth"] = f"{math.degrees(math.atan2(x, y)):.6g}° clockwise from y"
        return found


def text(value):
    """A value as text; empty for what is none."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:.12g}"
    return str(value) if isinstance(value, (int, str)) else ""


def with_unit(value, unit):
    """A value and its unit; a word has none."""
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    return f"{text(value)} {unit}".strip() if is_number else text(value)


def degrees(parts):
    """An angle of degrees, minutes, seconds and their millionths, as degrees."""
    return f"{sum(part / size for part, size in zip(parts, (1, 60, 3600, 3600e6))):.9g}°" if parts else ""
