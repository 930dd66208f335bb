//! XML documents as trees. A document is bounded, and has no entities of its own.

use quick_xml::{
    Reader, Writer, XmlVersion,
    escape::{EscapeError, resolve_predefined_entity},
    events::{BytesDecl, BytesEnd, BytesStart, BytesText, Event},
};
use thiserror::Error;

/// The most elements of a document, and the deepest nesting.
const ELEMENTS: usize = 500_000;
const DEPTH: usize = 64;

/// An element. Names are without their prefixes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) attributes: Vec<(String, String)>,
    pub(super) children: Vec<Self>,
    /// The text of an element without children.
    pub(super) text: String,
}

/// Why a document cannot be read.
#[derive(Debug, Error)]
#[error("line {line}")]
pub struct XmlError {
    /// The line, from 1.
    pub line: usize,
    /// The fault there.
    #[source]
    pub fault: XmlFault,
}

/// A fault of a document.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum XmlFault {
    /// It is in another encoding.
    #[error("it is not UTF-8")]
    Encoding,
    /// It declares a type, which may declare entities.
    #[error("it has a DOCTYPE, which BCF does not need: it may be hostile, and is not read")]
    Doctype,
    /// It refers to an entity.
    #[error("it refers to the entity {0:?}, which XML does not have")]
    Entity(String),
    /// It is not well formed.
    #[error("it is not well formed")]
    Syntax(#[from] quick_xml::Error),
    /// It is nested too deeply.
    #[error("it is nested deeper than {DEPTH} elements")]
    Depth,
    /// It has too many elements.
    #[error("it has more than {ELEMENTS} elements")]
    Elements,
    /// It ends too early, or has no element at all, or several.
    #[error("it is not one whole element")]
    Whole,
}

impl Element {
    pub(super) fn new(name: &str) -> Self {
        Self { name: name.to_owned(), ..Self::default() }
    }

    pub(super) fn leaf(name: &str, text: impl Into<String>) -> Self {
        Self { text: text.into(), ..Self::new(name) }
    }

    pub(super) fn with(mut self, name: &str, value: impl Into<String>) -> Self {
        self.attributes.push((name.to_owned(), value.into()));
        self
    }

    pub(super) fn add(&mut self, child: Self) -> &mut Self {
        self.children.push(child);
        self
    }

    /// The children of this name.
    pub(super) fn all<'e>(&'e self, name: &'e str) -> impl Iterator<Item = &'e Self> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// The first child of this name.
    pub(super) fn child(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| &**value)
    }

    /// The root of a document.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, XmlError> {
        let text = str::from_utf8(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes));
        let text = text.map_err(|_| XmlError { line: 1, fault: XmlFault::Encoding })?;
        let mut reader = Reader::from_str(text);
        reader.config_mut().expand_empty_elements = true;
        read(&mut reader).map_err(|fault| {
            let before = usize::try_from(reader.buffer_position()).unwrap_or(usize::MAX).min(text.len());
            let lines = text.as_bytes().get(..before).unwrap_or_default();
            XmlError { line: 1 + lines.iter().filter(|byte| **byte == b'\n').count(), fault }
        })
    }

    /// A document with this root.
    pub(super) fn to_bytes(&self) -> std::io::Result<Vec<u8>> {
        let mut writer = Writer::new_with_indent(Vec::new(), b' ', 2);
        writer.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
        self.write(&mut writer)?;
        Ok(writer.into_inner())
    }

    fn write(&self, writer: &mut Writer<Vec<u8>>) -> std::io::Result<()> {
        let mut start = BytesStart::new(&*self.name);
        start.extend_attributes(self.attributes.iter().map(|(name, value)| (&**name, &**value)));
        if self.children.is_empty() && self.text.is_empty() {
            return writer.write_event(Event::Empty(start));
        }
        writer.write_event(Event::Start(start))?;
        if self.children.is_empty() {
            writer.write_event(Event::Text(BytesText::new(&self.text)))?;
        }
        for child in &self.children {
            child.write(writer)?;
        }
        writer.write_event(Event::End(BytesEnd::new(&*self.name)))
    }
}

fn read(reader: &mut Reader<&[u8]>) -> Result<Element, XmlFault> {
    let (mut open, mut root, mut count): (Vec<Element>, _, usize) = (Vec::new(), None, 0);
    let local = |name: &[u8]| String::from_utf8_lossy(name).into_owned();
    loop {
        match reader.read_event()? {
            Event::Start(start) => {
                count += 1;
                if count > ELEMENTS {
                    return Err(XmlFault::Elements);
                }
                if open.len() == DEPTH {
                    return Err(XmlFault::Depth);
                }
                let mut element = Element::new(&local(start.local_name().as_ref()));
                for attribute in start.attributes() {
                    let attribute = attribute.map_err(quick_xml::Error::from)?;
                    let value = attribute.normalized_value(XmlVersion::Explicit1_0).map_err(named)?;
                    let name = local(attribute.key.local_name().as_ref());
                    element.attributes.push((name, value.into_owned()));
                }
                open.push(element);
            }
            Event::End(_) => {
                let Some(mut element) = open.pop() else { return Err(XmlFault::Whole) };
                if !element.children.is_empty() {
                    // White space between elements.
                    element.text.clear();
                }
                match open.last_mut() {
                    Some(parent) => parent.children.push(element),
                    None if root.is_none() => root = Some(element),
                    None => return Err(XmlFault::Whole),
                }
            }
            Event::Text(text) => {
                let text = text.xml10_content().map_err(quick_xml::Error::from)?;
                match open.last_mut() {
                    Some(element) => element.text.push_str(&text),
                    None if text.trim().is_empty() => {}
                    None => return Err(XmlFault::Whole),
                }
            }
            Event::CData(text) => {
                let text = text.xml10_content().map_err(quick_xml::Error::from)?;
                open.last_mut().ok_or(XmlFault::Whole)?.text.push_str(&text);
            }
            Event::GeneralRef(reference) => {
                let element = open.last_mut().ok_or(XmlFault::Whole)?;
                match reference.resolve_char_ref()? {
                    Some(c) => element.text.push(c),
                    None => {
                        let name = reference.decode().map_err(quick_xml::Error::from)?;
                        let known = resolve_predefined_entity(&name);
                        element.text.push_str(known.ok_or_else(|| XmlFault::Entity(name.into_owned()))?);
                    }
                }
            }
            Event::DocType(_) => return Err(XmlFault::Doctype),
            Event::Eof => {
                let is_whole = open.is_empty();
                return root.filter(|_| is_whole).ok_or(XmlFault::Whole);
            }
            Event::Empty(_) | Event::Comment(_) | Event::Decl(_) | Event::PI(_) => {}
        }
    }
}

/// Names the entity that an attribute refers to.
fn named(error: quick_xml::Error) -> XmlFault {
    match error {
        quick_xml::Error::Escape(EscapeError::UnrecognizedEntity(_, name)) => XmlFault::Entity(name),
        error => XmlFault::Syntax(error),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read(text: &str) -> Result<Element, XmlError> {
        Element::read(text.as_bytes())
    }

    #[test]
    fn a_document_is_read_as_a_tree() {
        let root = read(
            "\u{feff}<?xml version=\"1.0\"?><!-- c --><x:a xmlns:x='u' b='1 &lt; &#50;'>\n  <c> d &amp;\r\n\
             <![CDATA[<e>]]></c><c/>\n</x:a>\n",
        );
        let root = root.unwrap();
        assert_eq!((&*root.name, root.attribute("b"), &*root.text), ("a", Some("1 < 2"), ""));
        let texts: Vec<_> = root.all("c").map(|child| &*child.text).collect();
        assert_eq!(texts, [" d &\n<e>", ""]);
        assert!(root.child("d").is_none());
    }

    #[test]
    fn hostile_and_damaged_documents_are_refused_with_their_line() {
        let lines = |text: &str| {
            let XmlError { line, fault } = read(text).unwrap_err();
            (line, fault)
        };
        let laughs = "<?xml version='1.0'?>\n\
                      <!DOCTYPE lolz [<!ENTITY lol \"lol\"><!ENTITY lol2 \"&lol;&lol;\">]>\n\
                      <lolz>&lol2;</lolz>";
        assert!(matches!(lines(laughs), (2, XmlFault::Doctype)));
        let external = "<!DOCTYPE foo SYSTEM \"file:///etc/passwd\"><foo/>";
        assert!(matches!(lines(external), (1, XmlFault::Doctype)));
        let entity = lines("<a>\n\n&xxe;</a>");
        assert!(matches!(&entity, (3, XmlFault::Entity(name)) if name == "xxe"), "{entity:?}");
        let entity = lines("<a b='&xxe;'/>");
        assert!(matches!(&entity, (1, XmlFault::Entity(name)) if name == "xxe"), "{entity:?}");
        assert!(matches!(lines(&"<a>".repeat(DEPTH + 1)), (1, XmlFault::Depth)));
        let many = format!("<a>{}</a>", "<b/>".repeat(ELEMENTS));
        assert!(matches!(lines(&many), (1, XmlFault::Elements)));
        let nested = format!("{}{}", "<a>".repeat(DEPTH), "</a>".repeat(DEPTH));
        let most = format!("<a>{}</a>", "<b/>".repeat(ELEMENTS - 1));
        assert!(read(&nested).is_ok() && read(&most).is_ok());
        for cut in ["", "  ", "<a>", "<a/><b/>", "<a></a>text", "text<a/>"] {
            assert!(matches!(lines(cut), (1, XmlFault::Whole)), "{cut}: {:?}", lines(cut));
        }
        for wrong in
            ["<a></b>", "<a", "<a b>", "<a b='1' b='2'/>", "<a>&#0;</a>", "<a>&#xffffffffff;</a>", "<a>&</a>"]
        {
            assert!(matches!(lines(wrong), (1, XmlFault::Syntax(_))), "{wrong}: {:?}", lines(wrong));
        }
        let utf_16: Vec<u8> = "<a/>".encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert!(matches!(
            Element::read(&[&[0xff, 0xfe], &utf_16[..]].concat()).unwrap_err().fault,
            XmlFault::Encoding
        ));
    }

    proptest! {
        #[test]
        fn a_tree_is_read_as_it_was_written(
            texts in prop::collection::vec("[ -~\\n\\täöü<>&\"']{0,12}", 1..6),
        ) {
            let mut root = Element::new("Root").with("a", texts[0].replace(['\n', '\t'], " "));
            for text in &texts {
                root.add(Element::leaf("Leaf", text.clone()));
            }
            prop_assert_eq!(Element::read(&root.to_bytes().unwrap()).unwrap(), root);
        }

        #[test]
        fn no_bytes_panic(
            bytes in prop::collection::vec(any::<u8>(), 0..200), like in "[<>a/&;!\\[\\]= '\"?x-]{0,60}",
        ) {
            let _read = (Element::read(&bytes), Element::read(like.as_bytes()));
        }
    }
}
