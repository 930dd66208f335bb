"""A glTF file in its binary form. Triangles go to a file of their own at once: there may be many."""

import hashlib
import json
import os
import shutil
import struct

import numpy

from opening import Refused

# The colour of what has none, and an opacity.
GREY = (0.6, 0.6, 0.6, 1.0)
# The most that the format's 32 bits can count.
MOST_BYTES = (1 << 32) - 1
FLOAT, UNSIGNED_INT = 5126, 5125
JSON, BIN = 0x4E4F534A, 0x004E4942


class Glb:
    """A file that is being made."""

    def __init__(self, folder):
        self.path = os.path.join(folder, "model.glb")
        self.bytes_path = os.path.join(folder, "model.bin")
        self.bytes = open(self.bytes_path, "wb")
        self.views, self.accessors, self.meshes = [], [], []
        # The number of each colour.
        self.materials = {}
        # Of each geometry of the engine, by its name: the number of its mesh, and its middle.
        self.known = {}
        # The number of each mesh, by a hash of what it is made of: programs repeat shapes.
        self.equal = {}

    def mesh(self, shape):
        """The number of a shape's mesh, and its place, a matrix by columns; nothing for a shape without
        triangles or without a place. Shapes of one geometry share the mesh."""
        geometry = shape.geometry
        if geometry.id not in self.known:
            self.known[geometry.id] = self.new_mesh(geometry)
        mesh, middle = self.known[geometry.id]
        place = numpy.frombuffer(shape.transformation_buffer, "d").reshape((4, 4), order="F").copy()
        place[:3, 3] += place[:3, :3] @ middle
        if mesh is None or not numpy.isfinite(place).all():
            return None
        return mesh, place.flatten(order="F").tolist()

    def new_mesh(self, geometry):
        """Adds a mesh about its middle, so that single precision suffices. Returns its number and that."""
        positions = numpy.frombuffer(geometry.verts_buffer, "d").reshape(-1, 3)
        faces = numpy.frombuffer(geometry.faces_buffer, "i").reshape(-1, 3)
        # The number of each triangle's style.
        styles = numpy.frombuffer(geometry.material_ids_buffer, "i")
        if len(faces) == 0:
            return None, numpy.zeros(3)
        middle = positions.min(axis=0) / 2 + positions.max(axis=0) / 2
        about = (positions - middle).astype("<f4")
        parts = []
        for style in numpy.unique(styles):
            colour = colour_of(geometry.materials[style]) if style >= 0 else GREY
            material = self.materials.setdefault(colour, len(self.materials))
            parts.append((material, faces[styles == style].astype("<u4")))
        whole = hashlib.blake2b(about.tobytes(), digest_size=32)
        for material, corners in parts:
            whole.update(b"%d %d " % (material, len(corners)) + corners.tobytes())
        key = whole.digest()
        if key not in self.equal:
            self.equal[key] = len(self.meshes)
            self.meshes.append({"primitives": self.primitives(about, parts)})
        return self.equal[key], middle

    def primitives(self, positions, parts):
        """Adds the arrays of a mesh, of which each part has a material."""
        limits = {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
        attributes = {"POSITION": self.accessor(positions, FLOAT, "VEC3", len(positions), **limits)}
        return [
            {
                "attributes": attributes,
                "indices": self.accessor(corners, UNSIGNED_INT, "SCALAR", corners.size),
                "material": material,
            }
            for material, corners in parts
        ]

    def accessor(self, array, component, kind, count, **limits):
        """Adds an array, and returns its number."""
        offset = self.bytes.tell()
        self.bytes.write(array.tobytes())
        self.views.append({"buffer": 0, "byteOffset": offset, "byteLength": array.nbytes})
        view = len(self.views) - 1
        self.accessors.append(
            {"bufferView": view, "componentType": component, "type": kind, "count": count, **limits}
        )
        return len(self.accessors) - 1

    def write(self, nodes, roots):
        """Writes the file: `nodes` one after the other, so that they are not in memory at once."""
        length = self.bytes.tell()
        self.bytes.close()
        arrays = {
            "asset": [{"version": "2.0", "generator": "trimaran-ifc"}],
            "scenes": [{"nodes": roots}],
            "buffers": [{"byteLength": length}],
            "bufferViews": self.views,
            "accessors": self.accessors,
            "meshes": self.meshes,
            "materials": map(material_of, self.materials),
            "nodes": nodes,
        }
        with open(self.path, "wb") as file:
            file.write(bytes(20))
            separator = b"{"
            for name, values in arrays.items():
                is_array = name != "asset"
                file.write(separator + encoded(name) + (b":[" if is_array else b":"))
                for number, one in enumerate(values):
                    file.write((b"," if number else b"") + encoded(one))
                file.write(b"]" if is_array else b"")
                separator = b","
            file.write(b"}")
            file.write(b" " * (-file.tell() % 4))
            text = file.tell() - 20
            file.write(struct.pack("<II", length, BIN))
            with open(self.bytes_path, "rb") as triangles:
                shutil.copyfileobj(triangles, file)
            whole = file.tell()
            if whole > MOST_BYTES:
                raise Refused(f"its triangles take {whole} bytes, and the most is {MOST_BYTES}")
            file.seek(0)
            file.write(struct.pack("<4sIIII", b"glTF", 2, whole, text, JSON))
        os.unlink(self.bytes_path)


def encoded(value):
    """A value as JSON. Bytes that are no character, as in a file's name that is not UTF-8, are replaced."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False).encode("utf-8", "replace")


def colour_of(style):
    """A style's colour and opacity, from 0 to 1, as the file says them."""
    colour = style.get_color()
    parts = [colour.r(), colour.g(), colour.b()]
    opacity = 1 - style.transparency if style.has_transparency() else 1.0
    if not all(map(numpy.isfinite, (*parts, opacity))):
        return GREY
    return tuple(round(min(max(part, 0.0), 1.0), 4) for part in (*parts, opacity))


def material_of(colour):
    """A material of a colour. glTF has colours in linear light, and IFC as screens have them (sRGB)."""
    *parts, opacity = colour
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    mode = {"alphaMode": "BLEND"} if opacity < 1 else {}
    return {"pbrMetallicRoughness": {"baseColorFactor": [*linear, opacity]}, **mode}
