"""A conversion: opens the file, makes triangles of its elements, and writes them with their hierarchy."""

from collections import Counter

from attributes import Attributes
from glb import Glb
from model import Model
from opening import Refused, opened, parser_errors
from place import Unplaced, place
from shapes import shapes, unmeshed
from tree import Tree

# The percent of a conversion at which its phases end.
OPENED, MESHED = 10, 90
# The place of a model with y up, and of one with z up, where (x, y, z) becomes (x, z, -y): by columns.
NO_TURN = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
Z_UP = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]


class Progress:
    """Prints each percent once."""

    def __init__(self):
        self.last = -1

    def tell(self, percent):
        if percent > self.last:
            self.last = percent
            print(f"progress {percent}", flush=True)

    def between(self, first, last):
        """A function that prints the percent of a part of a phase."""
        return lambda part: self.tell(int(first + (last - first) * part))


def convert(path, folder, tolerance, is_y_up, name):
    """Converts a file to FOLDER/model.glb."""
    progress = Progress()
    progress.tell(0)
    model = Model(opened(path, folder))
    errors = parser_errors()
    if errors:
        tell("unparsed", len(errors), errors[0])
    progress.tell(OPENED)

    glb = Glb(folder)
    # Of each product, by its number: its meshes and their places.
    placed = {}
    for shape in shapes(model, tolerance, progress.between(OPENED, MESHED)):
        mesh = glb.mesh(shape)
        if mesh:
            placed.setdefault(shape.id, []).append(mesh)
    for product in unmeshed(model, placed):
        tell("unmeshed", 1, name_of(product))
    if not placed:
        first = f" ({errors[0]})" if errors else ""
        raise Refused(f"it has no element with a surface to draw{first}")
    spaces = model.of_class("IfcSpace")
    if spaces:
        tell("spaces", len(spaces), name_of(spaces[0]))

    tree = Tree(model, placed)
    attributes = Attributes(model)
    write = progress.between(MESHED, 100)

    def nodes():
        for number, node in enumerate(tree.nodes(attributes, name, NO_TURN if is_y_up else Z_UP)):
            write(number / tree.count)
            yield node

    glb.write(nodes(), [0])
    # In a file with y up, north is nowhere.
    if not is_y_up:
        tell_place(model)
    for product, count in Counter(attributes.unread).items():
        tell("unread", count, name_of(model.file.by_id(product)))
    write(1)


def tell_place(model):
    """Prints where the model stands on a map, if the file says it."""
    try:
        found = place(model)
    except MemoryError:
        raise
    except Exception as error:  # of the engine: the model is none the worse for it
        tell("unplaced", 1, str(error) if isinstance(error, Unplaced) else f"{type(error).__name__}: {error}")
        return
    if found is not None:
        frame, scale = found
        print("plant", *map(repr, frame), flush=True)
        if scale != 1:
            tell("scaled", 1, f"{scale:.12g}")


def tell(word, count, name):
    """Prints a line about some things, and the name of one."""
    print(word, count, " ".join(name.split()), flush=True)


def name_of(product):
    """The name of a product, or that of its class."""
    return product.Name or product.is_a()
