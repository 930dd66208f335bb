//! One buffer of the device in which pieces of geometry come and go.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use offset_allocator::{Allocation, Allocator};
use trimaran_scene::{Geometry, Vertex};

use crate::memory::{Buffer, HostBuffer};
use crate::scope;
use crate::stream::Stream;
use crate::{Gpu, GpuError};

/// Places are multiples of this many bytes: a vertex, and whole indices.
pub(crate) const UNIT: u64 = size_of::<Vertex>() as u64;

const _: () = assert!(UNIT.is_multiple_of(size_of::<u32>() as u64));

/// How much is copied at a time if the device's own memory cannot be written in place.
const STAGING_BYTES: usize = 4 << 20;

/// A buffer with its allocation state, and the means to copy into it.
pub(crate) struct Arena {
    // First, so that copies are done before the buffer goes.
    copies: Option<Copies>,
    buffer: Arc<Buffer>,
    places: Allocator,
    units: u32,
}

/// The place of a piece of geometry in the arena.
#[derive(Clone, Copy)]
pub(crate) struct Piece {
    allocation: Allocation,
    units: u32,
    vertices: u32,
}

/// Copies by the device, for memory invisible to the host.
struct Copies {
    stream: Stream,
    staging: HostBuffer<u8>,
    used: usize,
    /// The offsets in `staging` and in the buffer, and the byte counts.
    regions: Vec<vk::BufferCopy>,
}

impl Piece {
    /// Its first vertex, counted from the buffer's start.
    pub(crate) const fn first_vertex(self) -> u32 {
        self.allocation.offset
    }

    /// Its first index, counted likewise.
    pub(crate) const fn first_index(self) -> u32 {
        (self.allocation.offset + self.vertices) * (UNIT as u32 / 4)
    }

    pub(crate) const fn bytes(self) -> u64 {
        self.units as u64 * UNIT
    }
}

/// The units that a piece of geometry takes.
pub(crate) fn units(geometry: &Geometry) -> Option<u32> {
    let indices = (size_of_val(&*geometry.indices) as u64).div_ceil(UNIT);
    u32::try_from(geometry.vertices.len() as u64 + indices).ok()
}

impl Arena {
    /// An empty arena of about `bytes` bytes. `staged`: copy by the device even if the host sees its memory.
    pub(crate) fn new(gpu: &Arc<Gpu>, bytes: u64, staged: bool) -> Result<Self, GpuError> {
        let units = u32::try_from(bytes / UNIT).unwrap_or(i32::MAX as u32).min(i32::MAX as u32);
        let usage = vk::BufferUsageFlags::VERTEX_BUFFER
            | vk::BufferUsageFlags::INDEX_BUFFER
            | vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_DST;
        let bytes = u64::from(units) * UNIT;
        let buffer = Buffer::new(gpu, "geometry", usage, MemoryLocation::GpuOnly, bytes)?;
        let copies = if staged || !buffer.is_writable() { Some(Copies::new(gpu)?) } else { None };
        // A cluster takes about 1.5 kB. With more pieces than this some room stays unused.
        let most = (units / 16).clamp(1 << 10, 1 << 22);
        Ok(Self { copies, buffer: Arc::new(buffer), places: Allocator::with_max_allocs(units, most), units })
    }

    /// Its size in bytes.
    pub(crate) const fn bytes(&self) -> u64 {
        self.units as u64 * UNIT
    }

    pub(crate) const fn buffer(&self) -> &Arc<Buffer> {
        &self.buffer
    }

    /// Whether a piece of geometry would fit into an empty arena.
    pub(crate) fn could_hold(&self, geometry: &Geometry) -> bool {
        units(geometry).is_some_and(|units| units <= self.units)
    }

    /// A place for a piece of geometry; `None` if there is no room.
    pub(crate) fn allocate(&mut self, geometry: &Geometry) -> Option<Piece> {
        let units = units(geometry)?;
        let allocation = self.places.allocate(units)?;
        Some(Piece { allocation, units, vertices: geometry.vertices.len() as u32 })
    }

    /// Frees a place. No present or later work may use it.
    pub(crate) fn free(&mut self, piece: Piece) {
        self.places.free(piece.allocation);
    }

    /// Fills a place. Work submitted after [`finish`](Self::finish) sees it.
    pub(crate) fn write(&mut self, piece: Piece, geometry: &Geometry) -> Result<(), GpuError> {
        let [vertices, indices]: [&[u8]; 2] =
            [bytemuck::cast_slice(&geometry.vertices), bytemuck::cast_slice(&geometry.indices)];
        let start = u64::from(piece.first_vertex()) * UNIT;
        self.write_at(start, vertices)?;
        self.write_at(start + vertices.len() as u64, indices)
    }

    fn write_at(&mut self, offset: u64, bytes: &[u8]) -> Result<(), GpuError> {
        match &mut self.copies {
            Some(copies) => copies.add(&self.buffer, offset, bytes),
            None => {
                self.buffer.write(offset, bytes);
                Ok(())
            }
        }
    }

    /// Submits the written data to the device.
    pub(crate) fn finish(&mut self) -> Result<(), GpuError> {
        self.copies.as_mut().map_or(Ok(()), |copies| copies.submit(&self.buffer))
    }
}

impl Copies {
    fn new(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let usage = vk::BufferUsageFlags::TRANSFER_SRC;
        Ok(Self {
            stream: Stream::new(gpu)?,
            staging: HostBuffer::new(gpu, "staging", usage, MemoryLocation::CpuToGpu, STAGING_BYTES)?,
            used: 0,
            regions: Vec::new(),
        })
    }

    fn add(&mut self, buffer: &Buffer, mut offset: u64, mut bytes: &[u8]) -> Result<(), GpuError> {
        while !bytes.is_empty() {
            if self.used == STAGING_BYTES {
                self.submit(buffer)?;
            }
            if self.regions.is_empty() {
                // The staging buffer may be written again once the last copies are done.
                self.stream.wait(OPERATION)?;
                self.used = 0;
            }
            let (now, later) = bytes.split_at(bytes.len().min(STAGING_BYTES - self.used));
            if let Some(room) = self.staging.elements_mut().get_mut(self.used..self.used + now.len()) {
                room.copy_from_slice(now);
            }
            let region =
                vk::BufferCopy { src_offset: self.used as u64, dst_offset: offset, size: now.len() as u64 };
            self.regions.push(region);
            self.used += now.len();
            offset += now.len() as u64;
            bytes = later;
        }
        Ok(())
    }

    fn submit(&mut self, buffer: &Buffer) -> Result<(), GpuError> {
        if self.regions.is_empty() {
            return Ok(());
        }
        let Self { stream, staging, regions, .. } = self;
        stream.submit(OPERATION, None, |commands| {
            commands.copy(staging.buffer(), buffer, regions);
            let any = (vk::PipelineStageFlags2::ALL_COMMANDS, vk::AccessFlags2::MEMORY_READ);
            commands.barrier(scope::COPY_WRITE, any);
        })?;
        regions.clear();
        Ok(())
    }
}

/// The name of copying in errors.
const OPERATION: &str = "copying geometry to the device";
