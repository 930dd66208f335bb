"""Where a model stands on a map."""

import math

from ifcopenshell.util.geolocation import get_crs, get_helmert_transformation_parameters, get_wcs
from ifcopenshell.util.unit import calculate_unit_scale, get_unit_scale

# How far a map's lengths may be from true ones. Within it are the scales of surveyors' grids.
NEARLY = 0.01


class Unplaced(Exception):
    """The map conversion says no place."""


def place(model):
    """East, north and up of the model's origin in metres, and north in degrees clockwise from y; then the
    scale of the map's lengths. Nothing if the file has no map conversion."""
    file = model.file
    # Its coordinates may be latitude and longitude.
    for operation in model.of_class("IfcRigidOperation"):
        if operation.FirstCoordinate.is_a("IfcPlaneAngleMeasure"):
            raise Unplaced("its coordinates are angles")
    conversion = file.by_type("IfcProject") and get_helmert_transformation_parameters(file)
    if not conversion:
        return None
    wcs = get_wcs(file)
    if wcs is not None and (wcs[:3] != [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]).any():
        # Readers differ in whether the map begins there.
        raise Unplaced("its context has an origin or axes of its own")
    metres, scale = scaled(conversion, calculate_unit_scale(file), unit_of_map(file))
    origin = [float(part) * metres for part in (conversion.e, conversion.n, conversion.h)]
    # The x axis on the map is as far from east as y is from north.
    north = math.degrees(math.atan2(conversion.xao, conversion.xaa))
    if not all(map(math.isfinite, (*origin, north, scale))):
        raise Unplaced("its numbers are not finite")
    return (*origin, north), scale


def unit_of_map(file):
    """Metres per unit of the map, if the file says it."""
    unit = (get_crs(file) or {}).get("MapUnit")
    if isinstance(unit, str):
        return 1.0 if unit.upper() in ("METRE", "METER", "M") else None
    return unit and get_unit_scale(unit)


def scaled(conversion, unit, map_unit):
    """Metres per unit of the map, and how many metres of the map a metre is there. A map that says no unit
    has the project's, or else metres, whichever makes sense of the scale."""
    if conversion.scale == 1.0 and conversion.factor_x == 1.0:
        # Many files say no scale where the units differ.
        return map_unit or unit, 1.0
    for metres in (map_unit,) if map_unit else (unit, 1.0):
        scale = conversion.scale * conversion.factor_x * metres / unit
        if abs(scale - 1) <= NEARLY:
            return metres, scale
    raise Unplaced(f"its scale {conversion.scale:g} does not fit its units")
