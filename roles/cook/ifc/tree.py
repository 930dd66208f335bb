"""The hierarchy of a model: its project, sites, buildings, storeys, elements and their parts."""

# The relation of an entity to what it is in, and the other end of that. The first that it has counts.
WITHIN = (
    ("ContainedInStructure", "RelatingStructure"),
    ("Decomposes", "RelatingObject"),
    ("Nests", "RelatingObject"),
    ("FillsVoids", "RelatingOpeningElement"),
    ("VoidsElements", "RelatingBuildingElement"),
    ("AdheresToElement", "RelatingElement"),
)
# The number of the root in a model without a project: no entity has it.
NO_PROJECT = 0


class Tree:
    """The drawn products, and all around them. `placed` are the meshes of each product, by its number."""

    def __init__(self, model, placed):
        self.model, self.placed = model, placed
        projects = model.of_class("IfcProject")
        self.root = projects[0].id() if projects else NO_PROJECT
        # The product around each one.
        self.parents = {self.root: None}
        for product in sorted(placed):
            self.add(product)
        # The products in each one, in the order of the file.
        self.children = {}
        for product, parent in sorted(self.parents.items(), key=lambda pair: pair[0]):
            self.children.setdefault(parent, []).append(product)
        # The number of each product's node, in the order of the nodes. A product with several nodes is a
        # group: those of its meshes follow it, and those of what is in it.
        self.numbers = {}
        self.count = 0
        waiting = [self.root]
        while waiting:
            product = waiting.pop()
            self.numbers[product] = self.count
            self.count += 1 + self.inner_meshes(product)
            waiting.extend(reversed(self.children.get(product, ())))

    def add(self, product):
        """Adds a product, and all around it. One that is in nothing, or in itself, is in the root."""
        path = set()
        while product not in self.parents:
            path.add(product)
            outer = self.outer(self.model.file.by_id(product))
            self.parents[product] = self.root if outer is None or outer in path else outer
            product = self.parents[product]

    def outer(self, entity):
        """The number of what an entity is in; none if it is in nothing. Openings are passed over."""
        relations = ((one, end) for relation, end in WITHIN for one in self.model.values(entity, relation))
        for one, end in relations:
            outer = self.model.value(one, end)
            if outer is not None and outer.is_a("IfcFeatureElementSubtraction"):
                return self.outer(outer)
            if outer is not None and outer.is_a("IfcObjectDefinition"):
                return outer.id()
        return None

    def inner_meshes(self, product):
        """How many of a product's meshes have nodes of their own."""
        meshes = len(self.placed.get(product, ()))
        return meshes if meshes > 1 or product in self.children else 0

    def nodes(self, attributes, name, matrix):
        """Yields the nodes of glTF. `name` is that of a root without one, and `matrix` its place."""
        for product, number in self.numbers.items():
            node = {"name": name, "extras": {}}
            if product != NO_PROJECT:
                entity = self.model.file.by_id(product)
                own = name_of(self.model, entity)
                node = {"name": own or (name if product == self.root else entity.is_a())}
                node["extras"] = attributes.of(entity)
            if product == self.root:
                node["matrix"] = matrix
            meshes = self.inner_meshes(product)
            below = [self.numbers[child] for child in self.children.get(product, ())]
            if meshes or below:
                yield {**node, "children": [*range(number + 1, number + 1 + meshes), *below]}
            for mesh, place in self.placed.get(product, ()):
                yield {**node, "mesh": mesh, "matrix": place}


def name_of(model, entity):
    """An entity's own name, or its long one; empty if it has none."""
    names = (entity.Name, model.value(entity, "LongName"))
    return next((name for name in names if name and name.strip()), "")
