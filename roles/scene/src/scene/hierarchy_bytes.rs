//! The hierarchy in the file's format: bytes of postcard. It is decoded by hand, so that equal texts share
//! memory and the total is bounded.

use std::{collections::HashSet, ops::Range, sync::Arc};

use serde::Deserialize;

use super::{Attribute, Extent, Group, Hierarchy, ObjectAttributes, SceneArrays, SceneError};

/// The memory limit of a hierarchy: this many times its bytes, plus this many bytes.
const LARGEST_RATIO: usize = 8;
const FREE: usize = 16 << 20;

/// The memory of a text beside its bytes: two counts, and its entry among the others.
const TEXT: usize = 48;

/// The hierarchy as bytes.
pub(super) fn encode(arrays: &SceneArrays) -> Result<Vec<u8>, SceneError> {
    let malformed = |why| SceneError::Malformed { what: "hierarchy", index: 0, why };
    let bytes =
        postcard::to_stdvec(&arrays.hierarchy).map_err(|_| malformed("it is too large for memory"))?;
    if u32::try_from(bytes.len()).is_err() {
        return Err(malformed("its names and attributes have more than 4 GiB"));
    }
    if decode(&bytes).is_none() {
        return Err(malformed("its attributes are too many for the text that they have"));
    }
    Ok(bytes)
}

/// The reverse; `None` if the bytes are invalid, or would take much more memory than their size.
pub(super) fn decode(bytes: &[u8]) -> Option<Hierarchy> {
    let mut reader = Reader { rest: bytes, texts: HashSet::new(), left: FREE + LARGEST_RATIO * bytes.len() };
    let groups = reader.list(Reader::group)?;
    let attributes = reader.list(Reader::object_attributes)?;
    reader.rest.is_empty().then_some(Hierarchy { groups, attributes })
}

struct Reader<'b> {
    rest: &'b [u8],
    texts: HashSet<Arc<str>>,
    /// Bytes of memory that it may still take.
    left: usize,
}

impl<'b> Reader<'b> {
    fn take<T: Deserialize<'b>>(&mut self) -> Option<T> {
        let (value, rest) = postcard::take_from_bytes(self.rest).ok()?;
        self.rest = rest;
        Some(value)
    }

    fn spend(&mut self, bytes: usize) -> Option<()> {
        self.left = self.left.checked_sub(bytes)?;
        Some(())
    }

    fn text(&mut self) -> Option<Arc<str>> {
        let text: &str = self.take()?;
        if let Some(known) = self.texts.get(text) {
            return Some(Arc::clone(known));
        }
        self.spend(TEXT + text.len())?;
        let text: Arc<str> = text.into();
        self.texts.insert(Arc::clone(&text));
        Some(text)
    }

    fn list<T>(&mut self, each: impl Fn(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let count: usize = self.take()?;
        // Each has at least a byte.
        if count > self.rest.len() {
            return None;
        }
        self.spend(count * size_of::<T>())?;
        let mut list = Vec::with_capacity(count);
        for _ in 0..count {
            list.push(each(self)?);
        }
        Some(list)
    }

    fn attribute(&mut self) -> Option<Attribute> {
        Some(Attribute { name: self.text()?, value: self.text()? })
    }

    fn group(&mut self) -> Option<Group> {
        Some(Group {
            name: self.text()?,
            parent: self.take()?,
            objects: self.take::<Range<u32>>()?,
            attributes: self.list(Self::attribute)?,
            extent: self.take::<Extent>()?,
        })
    }

    fn object_attributes(&mut self) -> Option<ObjectAttributes> {
        Some(ObjectAttributes { object: self.take()?, attributes: self.list(Self::attribute)? })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn attributes() -> impl Strategy<Value = Vec<Attribute>> {
        let text = || prop_oneof![Just(""), Just("TAG"), Just("für")].prop_map(Arc::from);
        prop::collection::vec((text(), text()).prop_map(|(name, value)| Attribute { name, value }), 0..4)
    }

    fn hierarchy() -> impl Strategy<Value = Hierarchy> {
        let group = (any::<String>(), any::<Option<u32>>(), any::<[u32; 2]>(), attributes(), any::<u64>());
        let group = group.prop_map(|(name, parent, [start, end], attributes, triangles)| Group {
            name: name.into(),
            parent,
            objects: Range { start, end },
            attributes,
            extent: Extent { triangles, ..Extent::default() },
        });
        let of = (any::<u32>(), attributes());
        let of = of.prop_map(|(object, attributes)| ObjectAttributes { object, attributes });
        let lists = (prop::collection::vec(group, 0..6), prop::collection::vec(of, 0..6));
        lists.prop_map(|(groups, attributes)| Hierarchy { groups, attributes })
    }

    proptest! {
        #[test]
        fn what_was_written_is_read_and_nothing_less(hierarchy in hierarchy(), cut in 1_usize..20) {
            let bytes = postcard::to_stdvec(&hierarchy).unwrap();
            prop_assert_eq!(decode(&bytes), Some(hierarchy));
            prop_assert_eq!(decode(&bytes[..bytes.len().saturating_sub(cut)]), None);
            prop_assert_eq!(decode(&[&bytes[..], &[0]].concat()), None);
        }

        #[test]
        fn no_bytes_are_too_odd(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _read = decode(&bytes);
        }
    }

    #[test]
    fn equal_texts_are_one() {
        let tag = |value: &str| Attribute { name: "TAG".into(), value: value.into() };
        let of = |object| ObjectAttributes { object, attributes: vec![tag("long text"), tag("long text")] };
        let written = Hierarchy { groups: Vec::new(), attributes: (0..50).map(of).collect() };
        let read = decode(&postcard::to_stdvec(&written).unwrap()).unwrap();
        let all: Vec<&Attribute> = read.attributes.iter().flat_map(|of| &of.attributes).collect();
        assert!(all.iter().all(|one| Arc::ptr_eq(&one.name, &all[0].name)));
        assert!(all.iter().all(|one| Arc::ptr_eq(&one.value, &all[0].value)));
    }

    /// Two bytes would become 32: a file of 40 MB, 1.3 MB packed, would take 640.
    #[test]
    fn a_list_of_nothing_takes_no_more_memory_than_it_may() {
        const COUNT: usize = 20 << 20;
        let mut bytes = postcard::to_stdvec(&(0_usize, 1_usize, 7_u32, COUNT)).unwrap();
        bytes.resize(bytes.len() + 2 * COUNT, 0);
        assert_eq!(decode(&bytes), None);
        let few = postcard::to_stdvec(&(0_usize, 1_usize, 7_u32, 100_usize)).unwrap();
        let read = decode(&[&few[..], &[0; 200]].concat()).unwrap();
        assert_eq!(read.attributes[0].attributes.len(), 100);
    }
}
