"""Opens a file: unpacks it if it is packed, and spells its letters as the format demands."""

import codecs
import os
import re
import shutil
import zipfile

import ifcopenshell

# The last line of a file, and how many of the last bytes it is in: a signature may follow it.
END, NEAR_END = b"END-ISO-10303-21", 1 << 16
# Letters that are not ASCII. Files are to spell them with backslashes, and the engine drops others.
FOREIGN = re.compile(rb"[\x80-\xff]+")
# An archive unpacks to at most this many bytes, and this many for each of its own: only malicious files are
# packed better.
UNPACKED, UNPACKED_A_BYTE = 64 << 20, 64


class Refused(Exception):
    """A file of which no model can be made."""


def opened(path, folder):
    """The model in a file, or in a ZIP archive. Copies in `folder` are removed."""
    copies = []

    def copy(name):
        copies.append(os.path.join(folder, name))
        return copies[-1]

    try:
        with open(path, "rb") as start:
            is_packed = start.read(4) == b"PK\x03\x04"
        text = unpacked(path, copy("input.ifc")) if is_packed else path
        text = spelt(text, lambda: copy("spelt.ifc"))
        check_end(text)
        return ifcopenshell.open(text, format=".ifc")
    except ifcopenshell.Error as error:
        raise Refused(error) from error
    finally:
        for made in filter(os.path.exists, copies):
            os.unlink(made)


def parser_errors():
    """The parts of a file that the engine left out while it read it: it goes on without a word."""
    return re.findall(r"^\[error\](?: \[[^]]*\])* (.*)$", ifcopenshell.get_log(), re.MULTILINE)


def unpacked(path, target):
    """Unpacks the file in a ZIP archive to `target`, and returns that."""
    try:
        with zipfile.ZipFile(path) as archive:
            files = [one for one in archive.infolist() if one.filename.lower().endswith(".ifc")]
            # macOS adds a file of its own for each.
            files = [one for one in files if not one.filename.startswith("__MACOSX/")]
            if not files:
                raise Refused("the archive holds no .ifc file; ifcXML is not read")
            most = UNPACKED + UNPACKED_A_BYTE * os.path.getsize(path)
            if files[0].file_size > most:
                raise Refused(f"it unpacks to more than {most} bytes; if it is a model, unpack it first")
            # It reads no more than the size that was compared.
            with archive.open(files[0]) as source, open(target, "wb") as text:
                shutil.copyfileobj(source, text)
            return target
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError) as error:
        raise Refused(f"it cannot be unpacked: {error}") from error


def spelt(path, target):
    """A file with ASCII alone: itself, or else a copy, for which `target` gives the path. Other letters are
    UTF-8, or else Windows-1252."""
    with open(path, "rb") as source:
        if all(line.isascii() for line in source):
            return path
    made = target()
    with open(path, "rb") as source, open(made, "wb") as text:
        for number, line in enumerate(source):
            line = line.removeprefix(codecs.BOM_UTF8) if number == 0 else line
            text.write(FOREIGN.sub(lambda found: spelling(found[0]), line))
    return made


def spelling(letters):
    """The format's spelling of letters."""
    try:
        text = letters.decode()
    except UnicodeDecodeError:
        text = letters.decode("cp1252", "replace")
    return b"\\X4\\%s\\X0\\" % text.encode("utf-32-be").hex().upper().encode()


def check_end(path):
    """Refuses a file without its last line, of which the engine reads what is there without a word."""
    with open(path, "rb") as text:
        text.seek(max(os.path.getsize(path) - NEAR_END, 0))
        if END not in text.read():
            raise Refused("it is cut off: its last line, END-ISO-10303-21, is not there")
