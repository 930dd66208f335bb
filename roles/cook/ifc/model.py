"""A file's entities, and what its schema says of them."""

import ifcopenshell


class Model:
    """An opened file."""

    def __init__(self, file):
        self.file = file
        self.schema = ifcopenshell.schema_by_name(file.schema_identifier)
        self.names = {}

    def has_class(self, name):
        """Whether the schema has a class."""
        try:
            self.schema.declaration_by_name(name)
        except RuntimeError:
            return False
        return True

    def of_class(self, name):
        """The entities of a class, and of those below it."""
        return self.file.by_type(name) if self.has_class(name) else []

    def value(self, entity, name):
        """An attribute of an entity, or what an inverse one names; nothing if its class has none of this
        name. IfcOpenShell is slow to find that out."""
        kind = entity.is_a()
        if kind not in self.names:
            declaration = self.schema.declaration_by_name(kind)
            all_of = [*getattr(declaration, "all_attributes", tuple)()]
            all_of += getattr(declaration, "all_inverse_attributes", tuple)()
            self.names[kind] = frozenset(attribute.name() for attribute in all_of)
        return getattr(entity, name) if name in self.names[kind] else None

    def values(self, entity, name):
        """The entities that an attribute names: none, one or several."""
        value = self.value(entity, name)
        if value is None:
            return ()
        return value if isinstance(value, (tuple, list)) else (value,)
