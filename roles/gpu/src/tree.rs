//! A scene's tree on the device: the pages of nodes and drawables that traversals have visited.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::CutRule;
use trimaran_proto::DrawableId;
use trimaran_scene::{Node, Scene};

use crate::memory::{Buffer, HostBuffer};
use crate::recorder::Recorder;
use crate::scope;
use crate::{Gpu, GpuError};

/// A node or a piece to visit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct Entry {
    id: u32,
    /// Twice the step of the traversal that it belongs to, and one more if it is a piece. Shaders mark
    /// entries of mappings in the highest bit.
    step_and_kind: u32,
}

impl Entry {
    pub(crate) const ROOT: Self = Self { id: 0, step_and_kind: 0 };

    pub(crate) const fn piece(id: DrawableId) -> Self {
        Self { id: id.0, step_and_kind: 1 }
    }

    const fn is_piece(self) -> bool {
        self.step_and_kind & 1 != 0
    }
}

/// Records of a page.
const PAGE: usize = 64;
/// The least budget: that of far more pages than one node's.
const LEAST: u64 = 4 << 20;
/// Not on the device.
const ABSENT: u32 = u32::MAX;

/// How many bytes of nodes, and how many of drawables, a device may hold.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TreeBudget(pub(crate) u64);

impl TreeBudget {
    /// A sixteenth of the free memory, and what one buffer may have.
    pub(crate) fn new(gpu: &Gpu) -> Self {
        Self((gpu.limits().free_memory / 16).max(LEAST).min(gpu.limits().max_storage_range))
    }
}

/// A drawable on the device, with its own box if it is one of several pieces.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct DrawableRecord {
    local_min: [f32; 3],
    local_max: [f32; 3],
    error: f32,
    node: u32,
    pieces: u32,
}

/// The resident pages, which all cullers of the device share. Pages come as they are needed. If one finds no
/// room, all are dropped.
pub(crate) struct Tree {
    nodes: Table,
    drawables: Table,
    /// The place of each page of nodes, and then of drawables.
    pages: Buffer,
    places: Vec<u32>,
    node_pages: usize,
    /// Rises when all pages are dropped.
    generation: u64,
    /// Whether the device's list of places is to be emptied.
    is_stale: bool,
}

/// Pages of one kind of record.
struct Table {
    buffer: Buffer,
    record_bytes: usize,
    /// The most pages.
    most: usize,
    /// The resident pages, in the order of their places.
    resident: Vec<u32>,
}

impl Table {
    fn new(gpu: &Arc<Gpu>, record_bytes: usize, pages: usize, budget: TreeBudget) -> Result<Self, GpuError> {
        let page_bytes = (PAGE * record_bytes) as u64;
        let most = (budget.0 / page_bytes).max(1).min(pages as u64);
        use vk::BufferUsageFlags as Usage;
        let usage = Usage::STORAGE_BUFFER | Usage::TRANSFER_DST;
        let buffer = Buffer::new(gpu, "the tree", usage, MemoryLocation::GpuOnly, most * page_bytes)?;
        Ok(Self { buffer, record_bytes, most: most as usize, resident: Vec::new() })
    }

    const fn page_bytes(&self) -> usize {
        PAGE * self.record_bytes
    }
}

impl Tree {
    /// No page of `scene` is resident yet.
    pub(crate) fn new(gpu: &Arc<Gpu>, scene: &Scene, budget: TreeBudget) -> Result<Self, GpuError> {
        let [node_pages, drawable_pages] =
            [scene.nodes().len(), scene.drawables().len()].map(|records| records.div_ceil(PAGE));
        use vk::BufferUsageFlags as Usage;
        let (usage, bytes) = (Usage::STORAGE_BUFFER | Usage::TRANSFER_DST, 4 * (node_pages + drawable_pages));
        Ok(Self {
            nodes: Table::new(gpu, size_of::<Node>(), node_pages, budget)?,
            drawables: Table::new(gpu, size_of::<DrawableRecord>(), drawable_pages, budget)?,
            pages: Buffer::new(gpu, "the tree", usage, MemoryLocation::GpuOnly, bytes as u64)?,
            places: vec![ABSENT; node_pages + drawable_pages],
            node_pages,
            generation: 0,
            is_stale: true,
        })
    }

    pub(crate) const fn pages(&self) -> &Buffer {
        &self.pages
    }

    pub(crate) const fn nodes(&self) -> &Buffer {
        &self.nodes.buffer
    }

    pub(crate) const fn drawables(&self) -> &Buffer {
        &self.drawables.buffer
    }

    /// Where the pages of drawables begin among all pages.
    pub(crate) const fn drawable_pages(&self) -> u32 {
        self.node_pages as u32
    }

    /// How often all pages were dropped.
    pub(crate) const fn generation(&self) -> u64 {
        self.generation
    }

    /// Forgets all pages.
    pub(crate) fn drop_all(&mut self) {
        self.places.fill(ABSENT);
        self.nodes.resident.clear();
        self.drawables.resident.clear();
        self.generation += 1;
        self.is_stale = true;
    }
}

/// A culler's copies to the device, and the appearances of the resident nodes under its view state.
pub(crate) struct Upload {
    staging: HostBuffer<u8>,
    used: usize,
    nodes: Vec<vk::BufferCopy>,
    drawables: Vec<vk::BufferCopy>,
    places: Vec<vk::BufferCopy>,
    /// Two bits a node, a page each.
    appearances: HostBuffer<[u32; PAGE / 16]>,
    /// The rule and the generation of these, and how many pages of nodes are up to date.
    appearances_of: Option<(CutRule, u64, usize)>,
}

/// The bytes that a submission brings at most.
const STAGING_BYTES: usize = 1 << 20;

impl Upload {
    pub(crate) fn new(gpu: &Arc<Gpu>, tree: &Tree) -> Result<Self, GpuError> {
        use vk::BufferUsageFlags as Usage;
        let location = MemoryLocation::CpuToGpu;
        let pages = tree.nodes.most;
        Ok(Self {
            staging: HostBuffer::new(gpu, "staging", Usage::TRANSFER_SRC, location, STAGING_BYTES)?,
            used: 0,
            nodes: Vec::new(),
            drawables: Vec::new(),
            places: Vec::new(),
            appearances: HostBuffer::new(gpu, "appearances", Usage::STORAGE_BUFFER, location, pages)?,
            appearances_of: None,
        })
    }

    pub(crate) const fn appearances(&self) -> &Buffer {
        self.appearances.buffer()
    }

    /// Prepares copies of the pages that these entries lack, or of the first of them. The device is done with
    /// earlier ones.
    pub(crate) fn bring(
        &mut self,
        tree: &mut Tree,
        scene: &Scene,
        left: &[Entry],
        rule: &CutRule,
    ) -> Result<(), GpuError> {
        self.used = 0;
        for copies in [&mut self.nodes, &mut self.drawables, &mut self.places] {
            copies.clear();
        }
        let brought = scene.reading(|| {
            let _ = left.iter().try_for_each(|entry| self.bring_entry(tree, scene, *entry));
            self.show_new_nodes(tree, scene, rule);
        });
        brought.map_err(GpuError::Scene)
    }

    /// `None` if there is no more room now, or a record cannot be read.
    fn bring_entry(&mut self, tree: &mut Tree, scene: &Scene, entry: Entry) -> Option<()> {
        let drawable_page = |drawable: u32| tree_page(drawable) + tree.node_pages;
        if entry.is_piece() {
            let page = drawable_page(entry.id);
            self.bring_page(tree, scene, page)?;
            let node = scene.drawables().get(entry.id as usize)?.node;
            return self.bring_page(tree, scene, tree_page(node));
        }
        let node = scene.nodes().get(entry.id as usize)?;
        let last = (node.first_drawable + node.drawable_count).checked_sub(1);
        let pages = last.map(|last| drawable_page(node.first_drawable)..drawable_page(last) + 1);
        self.bring_page(tree, scene, tree_page(entry.id))?;
        pages.into_iter().flatten().try_for_each(|page| self.bring_page(tree, scene, page))
    }

    /// Prepares the copy of a page, unless it is resident.
    fn bring_page(&mut self, tree: &mut Tree, scene: &Scene, page: usize) -> Option<()> {
        let place = tree.places.get_mut(page)?;
        if *place != ABSENT {
            return Some(());
        }
        let (table, copies, page_of_kind) = if page < tree.node_pages {
            (&mut tree.nodes, &mut self.nodes, page)
        } else {
            (&mut tree.drawables, &mut self.drawables, page - tree.node_pages)
        };
        let room = self.staging.elements_mut().get_mut(self.used..)?;
        if table.resident.len() == table.most {
            if self.places.is_empty() {
                tree.drop_all();
            }
            return None;
        }
        let (bytes, number) = (table.page_bytes(), size_of_val(place));
        let (records, room) = room.split_at_mut_checked(bytes)?;
        *place = table.resident.len() as u32;
        room.get_mut(..number)?.copy_from_slice(&place.to_ne_bytes());
        fill(scene, page < tree.node_pages, page_of_kind, records);
        copies.push(copy(self.used, *place as usize * bytes, bytes));
        self.places.push(copy(self.used + bytes, page * number, number));
        self.used += bytes + number;
        table.resident.push(page_of_kind as u32);
        Some(())
    }

    /// Writes the appearances of nodes that are new on the device, or of all under another rule.
    fn show_new_nodes(&mut self, tree: &Tree, scene: &Scene, rule: &CutRule) {
        let resident = &tree.nodes.resident;
        let known = match &self.appearances_of {
            Some((before, generation, pages))
                if *generation == tree.generation && before.looks_like(rule) =>
            {
                *pages
            }
            _ => 0,
        };
        let slots = self.appearances.elements_mut().iter_mut().zip(resident).skip(known);
        for (slot, page) in slots {
            let first = *page * PAGE as u32;
            *slot = std::array::from_fn(|word| rule.appearance_bits(scene, first + 16 * word as u32));
        }
        self.appearances_of = Some((rule.clone(), tree.generation, resident.len()));
    }

    /// Records the copies.
    pub(crate) fn record(&self, commands: &Recorder<'_>, tree: &mut Tree) {
        if std::mem::replace(&mut tree.is_stale, false) {
            commands.fill(&tree.pages, ABSENT);
            commands.barrier(scope::FILL, scope::FILL);
        }
        let all =
            [(&self.nodes, tree.nodes()), (&self.drawables, tree.drawables()), (&self.places, tree.pages())];
        for (copies, buffer) in all {
            if !copies.is_empty() {
                commands.copy(self.staging.buffer(), buffer, copies);
            }
        }
    }
}

/// The page that has a record, among those of its kind.
const fn tree_page(number: u32) -> usize {
    number as usize / PAGE
}

const fn copy(from: usize, to: usize, bytes: usize) -> vk::BufferCopy {
    vk::BufferCopy { src_offset: from as u64, dst_offset: to as u64, size: bytes as u64 }
}

/// Writes the records of a page. Unreadable ones are left out, which [`Scene::reading`] tells.
fn fill(scene: &Scene, is_of_nodes: bool, page: usize, bytes: &mut [u8]) {
    let numbers = page * PAGE..(page + 1) * PAGE;
    if is_of_nodes {
        let nodes = bytes.chunks_exact_mut(size_of::<Node>()).zip(scene.nodes().range(numbers));
        nodes.for_each(|(slot, node)| slot.copy_from_slice(bytemuck::bytes_of(node)));
        return;
    }
    let drawables = bytes.chunks_exact_mut(size_of::<DrawableRecord>()).zip(scene.drawables().range(numbers));
    for (slot, drawable) in drawables {
        let piece = (drawable.pieces > 1).then(|| scene.places().get(drawable.geometry as usize)).flatten();
        let (local_min, local_max) =
            piece.map_or_else(Default::default, |piece| (piece.local_min, piece.local_max));
        let (error, node, pieces) = (drawable.error, drawable.node, drawable.pieces.into());
        let record = DrawableRecord { local_min, local_max, error, node, pieces };
        slot.copy_from_slice(bytemuck::bytes_of(&record));
    }
}
