//! Notes as the topics of BCF (`Markup`).

use std::str::FromStr;

use super::{
    super::{Date, Guid, HeaderFile, Note, Reply, Status, Topic},
    BcfError, BcfVersion,
    xml::Element,
};

/// The author of what has none.
const UNKNOWN: &str = "unknown";
/// The type of topics that have none: BCF 3.0 demands one.
const TYPE: &str = "Comment";
/// The status of topics that are done, in lower case.
const DONE: [&str; 5] = ["closed", "resolved", "done", "approved", "solved"];

/// A viewpoint that a topic names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Viewpoint {
    pub(super) guid: Guid,
    /// Files in the topic's folder.
    pub(super) file: Option<String>,
    pub(super) snapshot: Option<String>,
}

/// The status of a note, in BCF's words: those with which it came, if they still hold.
pub(super) fn status(note: &Note) -> &str {
    let came = note.topic.status.as_deref().filter(|came| status_of(Some(came)) == note.status);
    let ours = match note.status {
        Status::Open => "Open",
        Status::Closed => "Closed",
    };
    came.unwrap_or(ours)
}

fn status_of(text: Option<&str>) -> Status {
    let is_done = text.is_some_and(|text| DONE.contains(&&*text.trim().to_lowercase()));
    if is_done { Status::Closed } else { Status::Open }
}

/// The type of a topic.
pub(super) fn kind(note: &Note) -> &str {
    note.topic.kind.as_deref().unwrap_or(TYPE)
}

/// The document of a note.
pub(super) fn write(note: &Note, version: BcfVersion, viewpoints: &[Viewpoint]) -> Element {
    let is_new = version == BcfVersion::V3;
    let mut root = Element::new("Markup");
    let files: Vec<Element> = note.topic.files.iter().map(|file| write_file(file, version)).collect();
    if !files.is_empty() {
        let mut header = Element::new("Header");
        add_all(&mut header, files, is_new.then_some("Files"));
        root.add(header);
    }
    let mut topic = Element::new("Topic").with("Guid", note.guid.to_string());
    if let Some(id) = note.topic.server_id.as_ref().filter(|_| is_new) {
        topic = topic.with("ServerAssignedId", id);
    }
    let mut topic = topic.with("TopicType", kind(note)).with("TopicStatus", status(note));
    let Topic {
        priority, index, labels, links, modified, modified_by, due, assigned_to, stage, related, ..
    } = &note.topic;
    let leaves = |name: &str, texts: &[String]| -> Vec<Element> {
        texts.iter().map(|text| Element::leaf(name, text)).collect()
    };
    add_all(&mut topic, leaves("ReferenceLink", links), is_new.then_some("ReferenceLinks"));
    topic.add(Element::leaf("Title", &note.title));
    add(&mut topic, "Priority", priority.as_deref());
    add(&mut topic, "Index", index.map(|index| index.to_string()).as_deref());
    let (label, around) = if is_new { ("Label", Some("Labels")) } else { ("Labels", None) };
    add_all(&mut topic, leaves(label, labels), around);
    topic.add(Element::leaf("CreationDate", note.date.as_str()));
    topic.add(Element::leaf("CreationAuthor", &note.author));
    add(&mut topic, "ModifiedDate", modified.as_ref().map(Date::as_str));
    add(&mut topic, "ModifiedAuthor", modified_by.as_deref());
    add(&mut topic, "DueDate", due.as_ref().map(Date::as_str));
    add(&mut topic, "AssignedTo", assigned_to.as_deref());
    add(&mut topic, "Stage", stage.as_deref());
    add(&mut topic, "Description", Some(&note.text));
    let related = related.iter().map(|guid| Element::new("RelatedTopic").with("Guid", guid.to_string()));
    add_all(&mut topic, related.collect(), is_new.then_some("RelatedTopics"));
    let comments: Vec<Element> = note.replies.iter().map(|reply| write_reply(reply, version)).collect();
    let name = if is_new { "ViewPoint" } else { "Viewpoints" };
    let viewpoints: Vec<Element> = viewpoints.iter().map(|one| write_viewpoint(one, name)).collect();
    if is_new {
        add_all(&mut topic, comments, Some("Comments"));
        add_all(&mut topic, viewpoints, Some("Viewpoints"));
        root.add(topic);
    } else {
        root.add(topic);
        root.children.extend(comments);
        root.children.extend(viewpoints);
    }
    root
}

fn write_file(file: &HeaderFile, version: BcfVersion) -> Element {
    let mut element = Element::new("File");
    let is_external = file.is_external.map(|is| is.to_string());
    let external = if version == BcfVersion::V3 { "IsExternal" } else { "isExternal" };
    for (name, value) in [
        ("IfcProject", &file.project),
        ("IfcSpatialStructureElement", &file.element),
        (external, &is_external),
    ] {
        if let Some(value) = value {
            element = element.with(name, value);
        }
    }
    add(&mut element, "Filename", file.name.as_deref());
    add(&mut element, "Date", file.date.as_ref().map(Date::as_str));
    add(&mut element, "Reference", file.reference.as_deref());
    element
}

fn write_reply(reply: &Reply, version: BcfVersion) -> Element {
    let mut comment = Element::new("Comment").with("Guid", reply.guid.to_string());
    comment.add(Element::leaf("Date", reply.date.as_str()));
    comment.add(Element::leaf("Author", &reply.author));
    if version == BcfVersion::V2 || !reply.text.trim().is_empty() {
        comment.add(Element::leaf("Comment", &reply.text));
    }
    comment.children.extend(reply.view.map(|view| Element::new("Viewpoint").with("Guid", view.to_string())));
    comment
}

fn write_viewpoint(viewpoint: &Viewpoint, name: &str) -> Element {
    let mut element = Element::new(name).with("Guid", viewpoint.guid.to_string());
    add(&mut element, "Viewpoint", viewpoint.file.as_deref());
    add(&mut element, "Snapshot", viewpoint.snapshot.as_deref());
    element
}

/// Adds a text, unless it is blank.
fn add(element: &mut Element, name: &str, text: Option<&str>) {
    if let Some(text) = text.filter(|text| !text.trim().is_empty()) {
        element.add(Element::leaf(name, text));
    }
}

/// Adds elements, in one of the name `around` where that is given.
fn add_all(element: &mut Element, all: Vec<Element>, around: Option<&str>) {
    match around {
        _ if all.is_empty() => {}
        Some(name) => element.children.push(Element { children: all, ..Element::new(name) }),
        None => element.children.extend(all),
    }
}

/// A topic, its viewpoints, and how many of its files and snippets are left out.
pub(super) type Read = (Note, Vec<Viewpoint>, usize);

/// The note in a document, without views.
pub(super) fn read(root: &Element, entry: &str) -> Result<Read, BcfError> {
    let reading = Reading { entry };
    let topic = root.child("Topic").ok_or_else(|| reading.wrong("Topic", "is missing".to_owned()))?;
    // 3.0 has lists around what 2.1 has one beside the other.
    let both = |list: &'static str, name: &'static str| {
        topic.all(list).flat_map(move |list| list.all(name)).chain(topic.all(name))
    };
    let texts = |all: &mut dyn Iterator<Item = &Element>| -> Vec<String> {
        all.filter_map(|one| text(Some(&one.text))).collect()
    };
    // An element that has others has no text.
    let mut labels = both("Labels", "Label").chain(topic.all("Labels"));
    let files = root
        .all("Header")
        .flat_map(|header| header.all("File").chain(header.all("Files").flat_map(|list| list.all("File"))));
    let comments = root.all("Comment").chain(topic.all("Comments").flat_map(|list| list.all("Comment")));
    let viewpoints =
        root.all("Viewpoints").chain(topic.all("Viewpoints").flat_map(|list| list.all("ViewPoint")));
    let status = text(topic.attribute("TopicStatus"));
    let note = Note {
        guid: reading.guid(topic)?,
        title: text_in(topic, "Title")
            .ok_or_else(|| reading.wrong("Title", "is missing or empty".to_owned()))?,
        text: text_in(topic, "Description").unwrap_or_default(),
        author: text_in(topic, "CreationAuthor").unwrap_or_else(|| UNKNOWN.to_owned()),
        date: reading.needed(topic, "CreationDate")?,
        status: status_of(status.as_deref()),
        point: None,
        views: Vec::new(),
        replies: comments.map(|comment| reading.reply(comment)).collect::<Result<_, _>>()?,
        owner: None,
        topic: Topic {
            kind: text(topic.attribute("TopicType")),
            status,
            server_id: text(topic.attribute("ServerAssignedId")),
            priority: text_in(topic, "Priority"),
            index: reading.parsed(topic, "Index")?,
            labels: texts(&mut labels),
            links: texts(&mut both("ReferenceLinks", "ReferenceLink")),
            modified: reading.parsed(topic, "ModifiedDate")?,
            modified_by: text_in(topic, "ModifiedAuthor"),
            due: reading.parsed(topic, "DueDate")?,
            assigned_to: text_in(topic, "AssignedTo"),
            stage: text_in(topic, "Stage"),
            related: both("RelatedTopics", "RelatedTopic")
                .map(|one| reading.guid(one))
                .collect::<Result<_, _>>()?,
            files: files.map(|file| reading.file(file)).collect::<Result<_, _>>()?,
        },
    };
    let viewpoints = viewpoints.map(|one| reading.viewpoint(one)).collect::<Result<_, _>>()?;
    let left_out = both("DocumentReferences", "DocumentReference").chain(topic.all("BimSnippet")).count();
    Ok((note, viewpoints, left_out))
}

fn text(text: Option<&str>) -> Option<String> {
    text.filter(|text| !text.trim().is_empty()).map(str::to_owned)
}

fn text_in(element: &Element, name: &str) -> Option<String> {
    text(element.child(name).map(|child| &*child.text))
}

/// A document that is read.
struct Reading<'r> {
    entry: &'r str,
}

impl Reading<'_> {
    fn reply(&self, comment: &Element) -> Result<Reply, BcfError> {
        Ok(Reply {
            guid: self.guid(comment)?,
            author: text_in(comment, "Author").unwrap_or_else(|| UNKNOWN.to_owned()),
            date: self.needed(comment, "Date")?,
            text: text_in(comment, "Comment").unwrap_or_default(),
            view: comment.child("Viewpoint").map(|view| self.guid(view)).transpose()?,
        })
    }

    fn viewpoint(&self, viewpoint: &Element) -> Result<Viewpoint, BcfError> {
        Ok(Viewpoint {
            guid: self.guid(viewpoint)?,
            file: text_in(viewpoint, "Viewpoint"),
            snapshot: text_in(viewpoint, "Snapshot"),
        })
    }

    fn file(&self, file: &Element) -> Result<HeaderFile, BcfError> {
        let is_external = file.attribute("IsExternal").or_else(|| file.attribute("isExternal"));
        Ok(HeaderFile {
            project: text(file.attribute("IfcProject")),
            element: text(file.attribute("IfcSpatialStructureElement")),
            is_external: is_external.map(|is| matches!(is.trim(), "true" | "1")),
            name: text_in(file, "Filename"),
            date: self.parsed(file, "Date")?,
            reference: text_in(file, "Reference"),
        })
    }

    fn guid(&self, element: &Element) -> Result<Guid, BcfError> {
        let text = element.attribute("Guid").unwrap_or_default();
        text.trim().parse().map_err(|_| self.wrong("Guid", format!("is {text:?}, which is none")))
    }

    fn parsed<T: FromStr>(&self, element: &Element, name: &'static str) -> Result<Option<T>, BcfError> {
        let parse = |text: String| {
            text.trim().parse().map_err(|_| self.wrong(name, format!("is {text:?}, which is not valid")))
        };
        text_in(element, name).map(parse).transpose()
    }

    fn needed<T: FromStr>(&self, element: &Element, name: &'static str) -> Result<T, BcfError> {
        self.parsed(element, name)?.ok_or_else(|| self.wrong(name, "is missing".to_owned()))
    }

    fn wrong(&self, element: &'static str, why: String) -> BcfError {
        BcfError::Element { entry: self.entry.to_owned(), element, why }
    }
}
