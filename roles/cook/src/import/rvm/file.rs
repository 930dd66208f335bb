//! The content of an RVM file, in either form: its groups during reading, and its warnings.

use std::collections::HashMap;
use std::io::{self, Read, Seek};

use glam::{DAffine3, DVec3};
use trimaran_scene::Rgba8;

use super::encoding::Encoding;
use super::shape::{Broken, Numbers, Shape};
use super::{FilePosition, RvmError, chunks, colour, parse, text};
use crate::import::budget::Budget;
use crate::import::report::{ImportReport, WarningKind};

/// A file's groups.
pub(super) struct File<'b> {
    budget: &'b Budget,
    /// All of them, in the order in which they open.
    pub groups: Vec<Group>,
    /// Those with primitives of their own, in the same order after reading.
    pub solids: Vec<Solids>,
    /// The encoding of names, by the first head.
    pub encoding: Encoding,
    pub report: ImportReport,
    open: Vec<Solids>,
    /// The encoding of the model being read.
    own_encoding: Encoding,
    colours: HashMap<u32, [u8; 3]>,
    /// How many of `solids` have their colours.
    coloured: usize,
    heads: u32,
    /// Whether the last chunk was read.
    ended: bool,
}

/// A named group. Its number is its index among all groups of the file.
#[derive(Debug)]
pub(super) struct Group {
    pub name: String,
    /// The number of its parent.
    pub parent: Option<u32>,
    /// The end of its descendants' numbers.
    pub end: u32,
}

/// The primitives of a group.
#[derive(Debug)]
pub(super) struct Solids {
    /// Number of the group.
    pub group: u32,
    /// Index into the colour table, if the group has one.
    pub material: Option<u32>,
    /// Whether the table has that colour.
    pub colour_known: bool,
    pub colour: Rgba8,
    pub primitives: Vec<Primitive>,
}

impl Solids {
    const fn alpha(&self) -> u8 {
        let [_, _, _, alpha] = self.colour.0;
        alpha
    }
}

#[derive(Debug)]
pub(super) struct Primitive {
    /// Its place in the file, for errors.
    pub at: FilePosition,
    /// The primitive's frame to the file's: finite.
    pub matrix: DAffine3,
    /// The box stored with the primitive, in the primitive's frame. Not trusted.
    pub stored_box: [DVec3; 2],
    pub shape: Shape,
}

impl<'b> File<'b> {
    /// Reads a file of either form.
    pub(super) fn read(mut source: impl Read + Seek, budget: &'b Budget) -> Result<Self, RvmError> {
        let mut file = Self {
            budget,
            groups: Vec::new(),
            solids: Vec::new(),
            encoding: Encoding::default(),
            report: ImportReport::default(),
            open: Vec::new(),
            own_encoding: Encoding::default(),
            colours: HashMap::new(),
            coloured: 0,
            heads: 0,
            ended: false,
        };
        source.rewind()?;
        let mut start = Vec::new();
        source.by_ref().take(chunks::MAGIC.len() as u64).read_to_end(&mut start)?;
        source.rewind()?;
        let end = if start == chunks::MAGIC {
            parse::parse(source, &mut file)?
        } else {
            text::parse(&whole(source)?, &mut file)?
        };
        file.finish(end)?;
        Ok(file)
    }

    /// A model begins, with the encoding of its head.
    pub(super) fn begin(&mut self, encoding: &str) -> Result<(), RvmError> {
        if self.heads > 0 && !self.ended {
            self.report.warn(WarningKind::EndMissing, 1);
            self.end()?;
        }
        self.ended = false;
        self.own_encoding = Encoding::named(encoding).unwrap_or_else(|| {
            let label = encoding.escape_debug().to_string();
            self.report.warn_about(WarningKind::UnknownEncoding, &label, 1);
            Encoding::default()
        });
        if self.heads == 0 {
            self.encoding = self.own_encoding;
        }
        self.heads += 1;
        Ok(())
    }

    /// A name as text.
    pub(super) fn name(&mut self, bytes: &[u8]) -> String {
        let (name, fits) = self.own_encoding.decode(bytes);
        if !fits {
            self.report.warn_of(WarningKind::WrongEncoding, "", &name);
        }
        name
    }

    /// A group opens. One with an unreadable colour opens as well, for its content. Transparency is in
    /// percent; a group without one inherits it.
    pub(super) fn open(
        &mut self,
        name: &str,
        material: Option<u32>,
        transparency: Option<u32>,
        at: FilePosition,
    ) -> Result<(), RvmError> {
        self.ended = false;
        let name = name.trim();
        self.budget.depth(self.open.len() + 1, || format!("group {name:?} at {at}"))?;
        if material.is_none() {
            self.report.warn_of(WarningKind::BrokenGroup, "its colour cannot be read", name);
        }
        let group = self.groups.len() as u32;
        let alpha = match transparency {
            Some(percent @ 0..=100) => ((255 * (100 - percent) + 50) / 100) as u8,
            Some(senseless) => {
                let detail = format!("transparency {senseless}");
                self.report.warn_of(WarningKind::SenselessTransparency, &detail, name);
                255
            }
            None => self.open.last().map_or(255, |around| around.alpha()),
        };
        let colour = Rgba8([0, 0, 0, alpha]);
        let parent = self.open.last().map(|around| around.group);
        self.groups.push(Group { name: name.to_owned(), parent, end: group + 1 });
        self.open.push(Solids { group, material, colour_known: false, colour, primitives: Vec::new() });
        Ok(())
    }

    /// The innermost group ends.
    pub(super) fn close(&mut self) -> Result<(), RvmError> {
        let Some(solids) = self.open.pop() else {
            self.report.warn(WarningKind::ExtraGroupEnd, 1);
            return Ok(());
        };
        let next = self.groups.len() as u32;
        if let Some(group) = self.groups.get_mut(solids.group as usize) {
            group.end = next;
            if !solids.primitives.is_empty() {
                self.budget.objects(1, group.name.len(), || format!("group {:?}", group.name))?;
                self.solids.push(solids);
            }
        }
        Ok(())
    }

    /// A primitive of the innermost group: its kind, then its other data.
    pub(super) fn primitive(&mut self, numbers: &mut impl Numbers, order: Order, at: FilePosition) {
        let group = self.open.last_mut();
        let in_file = group.as_ref().and_then(|solids| self.groups.get(solids.group as usize));
        let name = in_file.map_or("", |group| &group.name);
        let read = numbers.count().and_then(|kind| Primitive::read(kind, numbers, order, at));
        match (read, group) {
            (Ok(primitive), Some(group)) => {
                if let Shape::FacetGroup { left_out, .. } = primitive.shape {
                    let detail = Broken::Corner.to_string();
                    self.report.warn_many(WarningKind::BrokenPolygon, &detail, name, left_out);
                }
                group.primitives.push(primitive);
            }
            (Err(broken), Some(_)) => {
                self.report.warn_of(WarningKind::BrokenPrimitive, &broken.to_string(), name);
            }
            (_, None) => {
                self.report.warn_about(WarningKind::BrokenPrimitive, &Broken::NoGroup.to_string(), 1);
            }
        }
    }

    pub(super) fn colour(&mut self, number: u32, colour: [u8; 3]) {
        self.colours.insert(number, colour);
    }

    /// A chunk that cannot be read.
    pub(super) fn leave_out(&mut self, id: &str, why: &str) {
        let group = self.open.last().and_then(|solids| self.groups.get(solids.group as usize));
        let detail = format!("{id}: {why}");
        match group {
            Some(group) => self.report.warn_of(WarningKind::BrokenChunk, &detail, &group.name),
            None => self.report.warn_about(WarningKind::BrokenChunk, &detail, 1),
        }
    }

    /// A chunk that is not read.
    pub(super) fn skip(&mut self, id: &str) {
        match id {
            "OBST" | "INSU" => self.report.warn(WarningKind::VolumeLeftOut, 1),
            _ => self.report.warn_about(WarningKind::UnknownChunk, id, 1),
        }
    }

    /// The model ends: its open groups end with it, and its colours do not apply to others.
    pub(super) fn end(&mut self) -> Result<(), RvmError> {
        self.ended = true;
        while let Some(last) = self.open.last() {
            let name = self.groups.get(last.group as usize).map_or("", |group| &group.name);
            self.report.warn_of(WarningKind::GroupLeftOpen, "", name);
            self.close()?;
        }
        for solids in self.solids.iter_mut().skip(self.coloured) {
            let alpha = solids.alpha();
            let known = solids.material.and_then(|number| colour::of(number, &self.colours));
            let [r, g, b] = known.unwrap_or(colour::GREY);
            (solids.colour_known, solids.colour) = (known.is_some(), Rgba8([r, g, b, alpha]));
        }
        self.coloured = self.solids.len();
        self.colours.clear();
        Ok(())
    }

    /// The file ends at `at`.
    fn finish(&mut self, at: FilePosition) -> Result<(), RvmError> {
        if !self.ended {
            if self.groups.is_empty() || !self.open.is_empty() {
                let what = if self.open.is_empty() { "a model" } else { "a group" };
                return Err(RvmError::Truncated { at, what });
            }
            self.report.warn(WarningKind::EndMissing, 1);
            self.end()?;
        }
        // They were kept in closing order.
        self.solids.sort_by_key(|solids| solids.group);
        Ok(())
    }
}

impl Primitive {
    fn read(kind: u32, numbers: &mut impl Numbers, order: Order, at: FilePosition) -> Result<Self, Broken> {
        let values: [f64; 12] = numbers.reals()?;
        let matrix = match order {
            Order::Columns => DAffine3::from_cols_array(&values),
            Order::Rows => {
                let [a, b, c, x, d, e, f, y, g, h, i, z] = values;
                DAffine3::from_cols_array(&[a, d, g, b, e, h, c, f, i, x, y, z])
            }
        };
        let [x0, y0, z0, x1, y1, z1] = numbers.reals()?;
        if !matrix.is_finite() {
            return Err(Broken::Matrix);
        }
        let stored_box = [DVec3::new(x0, y0, z0), DVec3::new(x1, y1, z1)];
        Ok(Self { at, matrix, stored_box, shape: Shape::read(kind, numbers)? })
    }
}

/// The order of a matrix's numbers: columns in the binary form, rows in the text form.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    Columns,
    Rows,
}

fn whole(mut source: impl Read) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    source.read_to_end(&mut bytes)?;
    Ok(bytes)
}
