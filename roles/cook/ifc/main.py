"""trimaran-ifc: IFC to glTF (.glb), by IfcOpenShell. `trimaran import` runs it as a process of its own: a
damaged file may crash the engine or take all memory. The engine has a licence of its own (LGPL).

    trimaran-ifc ifc INPUT FOLDER TOLERANCE_M y|z MEMORY_BYTES NAME

INPUT is a file of IFC2x3, IFC4 or IFC4x3, or a ZIP archive of one. NAME is for a project that has none.
It writes FOLDER/model.glb: right-handed, y up, metres. Standard output has a line for each step:
  progress PERCENT        how far it is
  unparsed COUNT ERROR    entities that cannot be read, and so are left out, with the first error
  unmeshed COUNT NAME     elements that got no triangles, and so are left out
  spaces COUNT NAME       spaces that are left out
  unread COUNT NAME       sets of properties that cannot be read, and so are left out
  plant E N U NORTH       the model's origin on a map, metres, and north, degrees clockwise from y
  scaled COUNT SCALE      lengths on the map over true ones, which moves nothing
  unplaced COUNT WHY      map conversions that say no place
and standard error the reason for a failure. The exit code is 0, or 2 for a file that cannot be read, or 3
where the memory does not suffice, or 4 where the engine cannot be loaded. When its parent ends, or it is told
to end, it removes the folder.
"""

import contextlib
import ctypes
import os
import resource
import signal
import sys
import time

BAD_FILE, NO_MEMORY, NO_ENGINE = 2, 3, 4
PR_SET_PDEATHSIG = 1  # of linux/prctl.h
ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# How often the memory is looked at, seconds.
POLL_S = 0.05


def fail(code, why):
    print(" ".join(str(why).split()), file=sys.stderr)
    return code


def end_with_parent(how, parent):
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, how)
    if os.getppid() != parent:
        os.kill(os.getpid(), how)


def convert(path, folder, tolerance, up, memory, name):
    """Converts a file, and returns the exit code."""
    # Each thread of an engine for matrices, which is not used here, would take memory.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    try:
        import conversion
    except ImportError as error:
        return fail(NO_ENGINE, error)
    # A limit that the system does not take is above its own.
    with contextlib.suppress(OSError, OverflowError, ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    try:
        conversion.convert(path, folder, tolerance, up == "y", name)
        return 0
    except MemoryError:
        return fail(NO_MEMORY, "no memory")
    except conversion.Refused as error:
        return fail(BAD_FILE, error)
    except OSError as error:
        return fail(BAD_FILE, f"it cannot be read, or its triangles cannot be written: {error}")
    except Exception as error:  # of the engine: it has no class of its own for most
        if "bad_alloc" in str(error):
            return fail(NO_MEMORY, "no memory")
        return fail(BAD_FILE, f"{type(error).__name__}: {error}")


def wait(child, memory):
    """Waits for the child's end, and returns its status; none if it was ended because it had taken nearly all
    memory. Where no more is left, the engine may hang or crash."""
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status
        with open(f"/proc/{child}/status") as lines:
            peak = sum(int(line.split()[1]) << 10 for line in lines if line.startswith("VmPeak:"))
        if peak > memory - memory // 16:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return None
        time.sleep(POLL_S)


def main(words):
    if len(words) != 7 or words[0] != "ifc" or words[4] not in ("y", "z"):
        return fail(BAD_FILE, "usage: trimaran-ifc ifc INPUT FOLDER TOLERANCE_M y|z MEMORY_BYTES NAME")
    path, folder, tolerance, up, memory, name = words[1:]
    memory = int(memory)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # The engine prints to standard output too.
    lines = os.fdopen(os.dup(1), "w", encoding="utf-8", errors="replace")
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 1)
    sys.stdout = lines
    own, parent = os.getpid(), os.getppid()
    child = 0

    def end(*_):
        if child:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        # `input` is what the import unpacked.
        for file in ("input", "input.ifc", "spelt.ifc", "model.bin", "model.glb"):
            with contextlib.suppress(OSError):
                os.unlink(os.path.join(folder, file))
        with contextlib.suppress(OSError):
            os.rmdir(folder)
        os._exit(1)

    for sign in ENDS:
        signal.signal(sign, end)
    end_with_parent(signal.SIGTERM, parent)
    # A second process computes: while the engine does, no signal is handled.
    child = os.fork()
    if child == 0:
        for sign in ENDS:
            signal.signal(sign, signal.SIG_IGN)
        end_with_parent(signal.SIGKILL, own)
        code = convert(path, folder, float(tolerance), up, memory, name)
        sys.stdout.flush()
        os._exit(code)
    status = wait(child, memory)
    if status is None:
        return fail(NO_MEMORY, "no memory")
    if os.WIFSIGNALED(status):
        # The import is to see how it ended.
        with contextlib.suppress(OSError):
            signal.signal(os.WTERMSIG(status), signal.SIG_DFL)
        os.kill(os.getpid(), os.WTERMSIG(status))
    return os.waitstatus_to_exitcode(status)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
