"""Triangles of a model's elements."""

import os

import ifcopenshell.geom

# Products that are no things. Spaces and zones are full of air and would hide their content. Virtual elements
# are borders of spaces, and openings are cut out.
NO_THINGS = ("IfcSpace", "IfcSpatialZone", "IfcVirtualElement", "IfcFeatureElementSubtraction")
# Representations that show a thing. Others are its axis, its box and its symbols on drawings.
SHOWN = ("Body", "Facetation", "Tessellation", "Surface", "")
# More threads than this take memory, and finish hardly sooner.
MOST_THREADS = 16


def shapes(model, tolerance, progress):
    """Yields the shapes of elements, of IfcOpenShell: one for each representation. Calls `progress` with the
    part that is done."""
    settings = ifcopenshell.geom.settings()
    settings.set("mesher-linear-deflection", tolerance)
    settings.set("apply-default-materials", False)
    settings.set("no-normals", True)
    threads = min(len(os.sched_getaffinity(0)), MOST_THREADS)
    iterator = ifcopenshell.geom.iterator(settings, model.file, threads, exclude=no_things(model))
    is_more = iterator.initialize()
    while is_more:
        yield iterator.get()
        progress(iterator.progress() / 100)
        is_more = iterator.next()


def unmeshed(model, placed):
    """The elements that are to have a surface, and are not in `placed`."""
    left_out = no_things(model)
    for product in model.of_class("IfcProduct"):
        is_thing = not any(map(product.is_a, left_out))
        if product.id() not in placed and is_thing and has_surface(model, product):
            yield product


def no_things(model):
    """The classes of `NO_THINGS` that the model's schema has."""
    return [name for name in NO_THINGS if model.has_class(name)]


def has_surface(model, product):
    """Whether an element is to have a surface."""
    shape = model.value(product, "Representation")
    parts = model.values(shape, "Representations") if shape else ()
    return any((part.RepresentationIdentifier or "") in SHOWN and part.Items for part in parts)
