// trimaran-occt: STEP and IGES to glTF (.glb), by Open CASCADE. `trimaran import` runs it as a process of its
// own: a damaged file may crash the engine or take all memory. The engine has a licence of its own (LGPL).
//
//   trimaran-occt step|iges INPUT FOLDER TOLERANCE_M y|z MEMORY_BYTES NAME
//
// NAME is for parts that have none, and that are in nothing that has one.
// It writes FOLDER/model.glb: right-handed, y up, metres. Standard output has a line for each step:
//   progress PERCENT         how far it is
//   unmeshed COUNT PART      faces of a part that got no triangles, and so are left out
// and standard error the reason for a failure. The exit code is 0, or 2 for a file that cannot be read, or 3
// where the memory does not suffice. When its parent ends, or it is told to end, it removes the folder.

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <new>
#include <string>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <BRepBndLib.hxx>
#include <BRepMesh_IncrementalMesh.hxx>
#include <BRep_Tool.hxx>
#include <Bnd_Box.hxx>
#include <IGESCAFControl_Reader.hxx>
#include <Message.hxx>
#include <Message_Messenger.hxx>
#include <Message_ProgressIndicator.hxx>
#include <Message_ProgressScope.hxx>
#include <RWGltf_CafWriter.hxx>
#include <STEPCAFControl_Reader.hxx>
#include <Standard_Failure.hxx>
#include <Standard_OutOfMemory.hxx>
#include <TColStd_IndexedDataMapOfStringString.hxx>
#include <TDF_LabelSequence.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <XCAFApp_Application.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_ShapeTool.hxx>

namespace {

constexpr int BAD_FILE = 2;
constexpr int NO_MEMORY = 3;
// The engine computes in millimetres.
constexpr double MILLIMETRES_A_METRE = 1000.0;
// No part is meshed finer than this fraction of its size: one huge part could take for ever.
constexpr double FINEST = 1e-5;
// The largest angle between neighbouring chords, radians: small curves stay round.
constexpr double LARGEST_ANGLE = 0.5;

// Files to remove when told to end. Made before the handler is set: it may call only functions such as unlink.
std::string unpacked, written, unfinished, folder;

void end(int) {
    unlink(unpacked.c_str());
    unlink(written.c_str());
    unlink(unfinished.c_str());
    rmdir(folder.c_str());
    _exit(1);
}

int fail(int code, const std::string &why) {
    std::fprintf(stderr, "%s\n", why.c_str());
    return code;
}

// A name as one line of text.
std::string name_of(const TDF_Label &label) {
    Handle(TDataStd_Name) name;
    if (!label.FindAttribute(TDataStd_Name::GetID(), name)) return "";
    TCollection_AsciiString text(name->Get());
    for (int at = 1; at <= text.Length(); ++at) {
        if (static_cast<unsigned char>(text.Value(at)) < ' ') text.SetValue(at, ' ');
    }
    return text.ToCString();
}

// Prints each percent once.
class Printed : public Message_ProgressIndicator {
    void Show(const Message_ProgressScope &, const Standard_Boolean) override {
        const int percent = static_cast<int>(100.0 * GetPosition());
        if (percent == last) return;
        last = percent;
        std::printf("progress %d\n", percent);
        std::fflush(stdout);
    }
    int last = -1;
};

// Reads a file into a document; false if it cannot be read.
template <class Reader>
bool read(Reader &reader, const char *path, Handle(TDocStd_Document) & document,
          const Message_ProgressRange &progress) {
    reader.SetColorMode(true);
    reader.SetNameMode(true);
    reader.SetLayerMode(false);
    return reader.ReadFile(path) == IFSelect_RetDone && reader.Transfer(document, progress);
}

// Makes triangles of each part once, whatever the number of its instances. Returns the number of faces.
int mesh(const Handle(XCAFDoc_ShapeTool) & shapes, double tolerance, const Message_ProgressRange &range) {
    TDF_LabelSequence labels;
    shapes->GetShapes(labels);
    Message_ProgressScope progress(range, "meshing", labels.Length());
    int all = 0;
    for (const TDF_Label &label : labels) {
        const Message_ProgressRange step = progress.Next();
        if (!XCAFDoc_ShapeTool::IsSimpleShape(label)) continue;
        const TopoDS_Shape shape = XCAFDoc_ShapeTool::GetShape(label);
        Bnd_Box box;
        BRepBndLib::Add(shape, box, false);
        const double size = box.IsVoid() ? 0.0 : std::sqrt(box.SquareExtent());
        IMeshTools_Parameters parameters;
        parameters.Deflection = std::max(tolerance, FINEST * size);
        parameters.Angle = LARGEST_ANGLE;
        BRepMesh_IncrementalMesh mesher;
        mesher.SetShape(shape);
        mesher.ChangeParameters() = parameters;
        mesher.Perform(step);
        int unmeshed = 0;
        for (TopExp_Explorer faces(shape, TopAbs_FACE); faces.More(); faces.Next(), ++all) {
            TopLoc_Location place;
            unmeshed += BRep_Tool::Triangulation(TopoDS::Face(faces.Current()), place).IsNull();
        }
        if (unmeshed > 0) std::printf("unmeshed %d %s\n", unmeshed, name_of(label).c_str());
    }
    return all;
}

// Names the unnamed parts within a shape after it, or after what it is in.
void name_below(const TDF_Label &shape, const std::string &name) {
    TDF_LabelSequence components;
    XCAFDoc_ShapeTool::GetComponents(shape, components);
    for (const TDF_Label &component : components) {
        TDF_Label part;
        if (!XCAFDoc_ShapeTool::GetReferredShape(component, part)) continue;
        const std::string own = name_of(part).empty() ? name_of(component) : name_of(part);
        const std::string known = own.empty() ? name : own;
        if (name_of(part).empty()) TDataStd_Name::Set(part, TCollection_ExtendedString(known.c_str(), true));
        name_below(part, known);
    }
}

int convert(bool is_step, const char *input, double tolerance, bool is_y_up, const char *name) {
    Message::DefaultMessenger()->ChangePrinters().Clear();
    // Else parts and instances without a name get one of the engine's own.
    XCAFDoc_ShapeTool::SetAutoNaming(false);
    const Handle(Printed) printed = new Printed();
    Message_ProgressScope progress(printed->Start(), "reading", 100);
    Handle(TDocStd_Document) document;
    XCAFApp_Application::GetApplication()->NewDocument("BinXCAF", document);

    bool is_read = false;
    if (is_step) {
        STEPCAFControl_Reader reader;
        is_read = read(reader, input, document, progress.Next(45));
    } else {
        IGESCAFControl_Reader reader;
        is_read = read(reader, input, document, progress.Next(45));
    }
    if (!is_read) return fail(BAD_FILE, "it cannot be read to its end");
    const Handle(XCAFDoc_ShapeTool) shapes = XCAFDoc_DocumentTool::ShapeTool(document->Main());
    if (mesh(shapes, tolerance * MILLIMETRES_A_METRE, progress.Next(45)) == 0) {
        return fail(BAD_FILE, "it has no faces: curves and points have no surface to draw");
    }

    TDF_LabelSequence roots;
    shapes->GetFreeShapes(roots);
    for (const TDF_Label &root : roots) {
        if (name_of(root).empty()) TDataStd_Name::Set(root, TCollection_ExtendedString(name, true));
        name_below(root, name_of(root));
    }
    RWGltf_CafWriter writer(written.c_str(), true);
    writer.SetMergeFaces(true);
    // Instances are often called `1` or `NAUO7`, and parts what people know them by: "bolt [NAUO7]".
    writer.SetNodeNameFormat(RWMesh_NameFormat_ProductAndInstance);
    RWMesh_CoordinateSystemConverter axes = writer.CoordinateSystemConverter();
    axes.SetInputLengthUnit(1.0 / MILLIMETRES_A_METRE);
    axes.SetInputCoordinateSystem(is_y_up ? RWMesh_CoordinateSystem_Yup : RWMesh_CoordinateSystem_Zup);
    writer.SetCoordinateSystemConverter(axes);
    const TColStd_IndexedDataMapOfStringString about;
    if (!writer.Perform(document, about, progress.Next(10))) {
        return fail(BAD_FILE, "its triangles cannot be written: the disk may be full");
    }
    return 0;
}

} // namespace

int main(int count, char **words) {
    if (count != 8) {
        return fail(BAD_FILE,
                    "usage: trimaran-occt step|iges INPUT FOLDER TOLERANCE_M y|z MEMORY_BYTES NAME");
    }
    folder = words[3];
    // The import's name for a file that was packed.
    unpacked = folder + "/input";
    written = folder + "/model.glb";
    // The writer's own name for what it has not joined yet.
    unfinished = written + ".bin.tmp";
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) std::signal(signal, end);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    const rlim_t memory = std::strtoull(words[6], nullptr, 10);
    const rlimit limit = {memory, memory};
    setrlimit(RLIMIT_AS, &limit);
    try {
        const bool is_step = !std::strcmp(words[1], "step");
        return convert(is_step, words[2], std::atof(words[4]), words[5][0] == 'y', words[7]);
    } catch (const Standard_OutOfMemory &) {
        return fail(NO_MEMORY, "no memory");
    } catch (const Standard_Failure &failure) {
        return fail(BAD_FILE, failure.GetMessageString());
    } catch (const std::bad_alloc &) {
        return fail(NO_MEMORY, "no memory");
    } catch (const std::exception &failure) {
        return fail(BAD_FILE, failure.what());
    }
}
