//! The chunks of an RVM file as groups with primitives.
//!
//! A chunk is four letters (each in four bytes), the byte at which the next chunk begins, a word of unknown
//! use, and a body that opens with a version. HEAD and MODL come first, END: last; between them CNTB opens a
//! group and CNTE closes it, PRIM is a primitive of the open group and COLR redefines a colour. What follows
//! END: is padding.

use std::collections::HashMap;

use glam::{DAffine3, DVec3};

use super::RvmError;
use super::reader::Reader;
use super::shape::{Shape, ShapeError};
use crate::import::{budget::Budget, hierarchy::Branch};

/// A file's groups that hold primitives themselves, and the colours it redefines.
#[derive(Debug, Default)]
pub(super) struct File {
    pub groups: Vec<Group>,
    /// Groups that hold groups, in the order in which they open. Their leaves are numbers of groups.
    pub branches: Vec<Branch>,
    pub colours: HashMap<u32, [u8; 3]>,
    /// Insulation and obstruction volumes, which are not read.
    pub volumes: u64,
}

/// A group with primitives of its own.
#[derive(Debug)]
pub(super) struct Group {
    /// Running number among all groups of the file, in the order in which they open.
    pub index: u32,
    pub name: String,
    /// Index into the colour table.
    pub material: u32,
    pub primitives: Vec<Primitive>,
}

#[derive(Debug)]
pub(super) struct Primitive {
    /// Byte of the chunk, for errors.
    pub offset: usize,
    /// The primitive's frame to the file's: finite.
    pub matrix: DAffine3,
    /// The box that the file stores with the primitive, in the primitive's frame: not trusted with anything.
    pub stored_box: [DVec3; 2],
    pub shape: Shape,
}

impl File {
    pub(super) fn parse(bytes: &[u8], budget: &Budget) -> Result<Self, RvmError> {
        let mut reader = Reader::new(bytes);
        let mut file = Self::default();
        let mut open: Vec<Group> = Vec::new();
        // Of each branch the number of its group, and of that which it is in.
        let mut branches: Vec<(u32, Option<u32>, Branch)> = Vec::new();
        let mut next_index = 0;
        expect(&mut reader, "HEAD")?;
        expect(&mut reader, "MODL")?;
        loop {
            let offset = reader.offset();
            let (id, mut body) = chunk(&mut reader)?;
            match &id {
                b"CNTB" => {
                    let group = group(&mut body, next_index)?;
                    budget.depth(open.len() + 1, || format!("group {:?} at byte {offset}", group.name))?;
                    open.push(group);
                    next_index += 1;
                }
                b"CNTE" => {
                    let what = "a group ends that never began";
                    let group = open.pop().ok_or(RvmError::Malformed { offset, what })?;
                    if next_index > group.index + 1 {
                        let (name, leaves) = (group.name.clone(), group.index..next_index);
                        let branch = Branch { name, parent: None, leaves, attributes: Vec::new() };
                        branches.push((group.index, open.last().map(|above| above.index), branch));
                    }
                    if !group.primitives.is_empty() {
                        budget.objects(1, group.name.len(), || format!("group {:?}", group.name))?;
                        file.groups.push(group);
                    }
                }
                b"PRIM" => {
                    let what = "a primitive stands outside of any group";
                    let group = open.last_mut().ok_or(RvmError::Malformed { offset, what })?;
                    let primitive = primitive(&mut body, offset, &group.name)?;
                    group.primitives.push(primitive);
                }
                b"COLR" => {
                    let what = "a colour";
                    body.u32(what)?;
                    let index = body.u32(what)?;
                    if let &[r, g, b] = body.take(3, what)? {
                        file.colours.insert(index, [r, g, b]);
                    }
                }
                b"OBST" | b"INSU" => file.volumes += 1,
                b"END:" => break,
                _ => return Err(unknown(offset, id)),
            }
        }
        if !open.is_empty() {
            let what = "the file ends while a group is open";
            return Err(RvmError::Malformed { offset: reader.offset(), what });
        }
        // Groups were kept as they closed; a file's order is that in which they open.
        file.groups.sort_by_key(|group| group.index);
        branches.sort_by_key(|(index, ..)| *index);
        let numbers: Vec<u32> = branches.iter().map(|(index, ..)| *index).collect();
        let number = |index: u32| numbers.binary_search(&index).ok().map(|number| number as u32);
        file.branches = branches
            .into_iter()
            .map(|(_, above, branch)| Branch { parent: above.and_then(number), ..branch })
            .collect();
        Ok(file)
    }
}

fn unknown(offset: usize, id: [u8; 4]) -> RvmError {
    RvmError::UnknownChunk { offset, id: id.iter().copied().map(char::from).collect() }
}

/// The chunk's four letters and its body.
fn chunk<'a>(reader: &mut Reader<'a>) -> Result<([u8; 4], Reader<'a>), RvmError> {
    let offset = reader.offset();
    let mut id = [0; 4];
    for letter in &mut id {
        let what = "a chunk does not begin with letters";
        let word = reader.u32("a chunk's header")?;
        *letter = u8::try_from(word).map_err(|_| RvmError::Malformed { offset, what })?;
    }
    let next = reader.u32("a chunk's header")? as usize;
    reader.u32("a chunk's header")?;
    // The last chunk may say anything of the next one.
    let body = if id == *b"END:" { reader.clone() } else { reader.split_until(next, "a chunk")? };
    Ok((id, body))
}

fn expect(reader: &mut Reader<'_>, expected: &str) -> Result<(), RvmError> {
    let offset = reader.offset();
    let (id, _) = chunk(reader)?;
    if id == *expected.as_bytes() { Ok(()) } else { Err(unknown(offset, id)) }
}

fn group(body: &mut Reader<'_>, index: u32) -> Result<Group, RvmError> {
    let what = "a group";
    body.u32(what)?;
    let name = body.string(what)?;
    // A reference point that no primitive depends on.
    body.floats::<3>(what)?;
    let material = body.u32(what)?;
    Ok(Group { index, name, material, primitives: Vec::new() })
}

fn primitive(body: &mut Reader<'_>, offset: usize, group: &str) -> Result<Primitive, RvmError> {
    let what = "a primitive";
    let unusable = |what| RvmError::Unusable { offset, group: group.to_owned(), what };
    body.u32(what)?;
    let kind = body.u32(what)?;
    // Column-major, three rows.
    let matrix = DAffine3::from_cols_array(&body.floats(what)?);
    let [x0, y0, z0, x1, y1, z1] = body.floats(what)?;
    if !matrix.is_finite() {
        return Err(unusable("its matrix has a value that is not finite"));
    }
    let shape = Shape::read(kind, body).map_err(|error| match error {
        ShapeError::Read(error) => error,
        ShapeError::UnknownKind(kind) => RvmError::UnknownPrimitive { offset, group: group.to_owned(), kind },
        ShapeError::NotFinite => unusable("one of its measures is not finite"),
    })?;
    let stored_box = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
    Ok(Primitive { offset, matrix, stored_box, shape })
}
