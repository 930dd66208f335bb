//! Shared by the three scene passes: draws come in batches, and go to the device in pieces, over one set of
//! attachments.

use std::sync::Arc;

use ash::vk;
use gpu_allocator::MemoryLocation;
use trimaran_cull::{Cancel, DepthImage, View, Viewport};
use trimaran_proto::{DeviceTimes, DrawableId};

use crate::camera::CameraConstants;
use crate::draw_record::Fetch;
use crate::draws::Draws;
use crate::layout::{BindingSet, Layout};
use crate::memory::{Buffer, HostBuffer, Image};
use crate::pass_kind::{PassKind, Pipelines, Style};
use crate::place::{Absent, Place};
use crate::recorder::Targets;
use crate::reuse::reuse_or_make;
use crate::scene::Hold;
use crate::sections::SectionPlanes;
use crate::stream::Stream;
use crate::timing::{Pass, PassTiming, Stopwatch};
use crate::wait::{SLICE, Wait};
#[cfg(feature = "window")]
use crate::window::Acquired;
use crate::{Gpu, GpuError, GpuScene};

/// Pieces of a scene drawn over one depth attachment and perhaps a colour attachment.
pub(crate) struct ScenePass {
    // First, so that the device is done before the fields below are dropped.
    stream: Stream,
    /// On the geometry of the frame's draws.
    hold: Hold,
    scene: Arc<GpuScene>,
    kind: &'static PassKind,
    pipelines: Pipelines,
    /// The style of the next draws; earlier ones are submitted.
    style: Style,
    /// One element: those of the current frame.
    sections: HostBuffer<SectionPlanes>,
    /// The sections, and the geometry if the shader fetches from it.
    set: BindingSet,
    /// The buffer with the frame's geometry.
    geometry: Arc<Buffer>,
    places: Vec<Option<Place>>,
    /// Bytes of geometry loaded to the device for this frame.
    brought: u64,
    draws: Draws,
    attachments: Attachments,
    view: Option<View>,
    /// Nothing was drawn since `begin`, so the first piece clears.
    fresh: bool,
    /// The sky was drawn in this frame.
    has_sky: bool,
    recording: Stopwatch,
    /// Counts changes of the depth.
    depth_version: u64,
    /// The host's copy of the depth, and its version.
    depth_on_host: Option<HostBuffer<f32>>,
    depth_on_host_version: Option<u64>,
}

/// The finished depth of a pass, to test boxes against.
pub(crate) struct OverDepth<'a> {
    pub(crate) stream: &'a mut Stream,
    pub(crate) size: Viewport,
    pub(crate) depth: &'a mut Image,
    /// Changes when the depth does.
    pub(crate) version: u64,
}

impl OverDepth<'_> {
    /// Attachments for testing: only the depth as it is.
    pub(crate) const fn targets<'i>(depth: &'i mut Image, size: Viewport) -> Targets<'i> {
        Targets { size, colour: None, depth, clear: false }
    }
}

struct Attachments {
    size: Viewport,
    depth: Image,
    colour: Option<Image>,
}

impl ScenePass {
    pub(crate) fn new(
        scene: &Arc<GpuScene>,
        kind: &'static PassKind,
        size: Viewport,
    ) -> Result<Self, GpuError> {
        let gpu = scene.gpu();
        let sections = HostBuffer::new(
            gpu,
            "sections",
            vk::BufferUsageFlags::STORAGE_BUFFER,
            MemoryLocation::CpuToGpu,
            1,
        )?;
        let geometry = Arc::clone(scene.set().buffer());
        let buffers = bound(kind, &sections, &geometry);
        let layout = Layout::new::<CameraConstants>(gpu, buffers.len() as u32)?;
        let set = BindingSet::new(&layout, &buffers)?;
        let mut pipelines = Pipelines::new(layout, kind);
        // The usual pipelines are made here, so that errors come before the first frame.
        pipelines.get(Style::default())?;
        Ok(Self {
            stream: Stream::new(gpu)?,
            hold: Hold::new(scene),
            scene: Arc::clone(scene),
            kind,
            pipelines,
            style: Style::default(),
            sections,
            set,
            geometry,
            places: Vec::new(),
            brought: 0,
            draws: Draws::new(Arc::clone(gpu), kind.fetch),
            attachments: Attachments::new(gpu, kind, size)?,
            view: None,
            fresh: true,
            has_sky: false,
            recording: Stopwatch::default(),
            depth_version: 0,
            depth_on_host: None,
            depth_on_host_version: None,
        })
    }

    pub(crate) const fn scene(&self) -> &Arc<GpuScene> {
        &self.scene
    }

    pub(crate) fn gpu(&self) -> &Arc<Gpu> {
        self.scene.gpu()
    }

    /// Waits for the device end early when `cancel` says so.
    pub(crate) fn cancel_when(&mut self, cancel: &Cancel) {
        self.stream.cancel_when(cancel);
    }

    /// The picture's size: that of the last view.
    pub(crate) const fn size(&self) -> Viewport {
        self.attachments.size
    }

    /// Starts a frame, after waiting for the last one. A view of another size changes the attachments.
    pub(crate) fn begin(&mut self, view: &View) -> Result<(), GpuError> {
        self.depth_version += 1;
        self.stream.restart(self.kind.name)?;
        self.recording = Stopwatch::default();
        if view.viewport() != self.attachments.size {
            self.attachments = Attachments::new(self.scene.gpu(), self.kind, view.viewport())?;
        }
        self.draws.clear();
        self.brought = 0;
        self.renew()?;
        self.style = Style { cut: !view.sections().is_empty(), see_through: false };
        if self.style.cut {
            self.sections.elements_mut().fill(SectionPlanes::new(view));
        }
        self.view = Some(*view);
        self.fresh = true;
        self.has_sky = false;
        Ok(())
    }

    /// Adds draws of solid drawables; they run at the next flush.
    pub(crate) fn draw(&mut self, ids: &[DrawableId]) -> Result<(), GpuError> {
        if self.style.see_through {
            return Err(GpuError::SolidAfterSeeThrough);
        }
        self.add(ids)
    }

    /// Adds draws that are blended over the earlier ones, until the end of the frame.
    pub(crate) fn draw_see_through(&mut self, ids: &[DrawableId]) -> Result<(), GpuError> {
        if !self.style.see_through {
            self.fill_sky()?;
            self.style.see_through = true;
        }
        self.add(ids)
    }

    /// Draws the added draws, and once per frame the sky behind them.
    fn fill_sky(&mut self) -> Result<(), GpuError> {
        self.flush()?;
        let view = self.view.ok_or(GpuError::NotBegun(self.kind.name))?;
        let Self { stream, kind, pipelines, attachments, has_sky, .. } = self;
        let Some(sky) = pipelines.sky()?.filter(|_| !*has_sky) else { return Ok(()) };
        let constants = CameraConstants::new(&view);
        stream.submit(kind.name, Some(Pass::Drawing), |commands| {
            commands.render(attachments.targets(kind, false), || {
                commands.bind(sky, &constants);
                commands.draw(3, 0..1);
            });
        })?;
        *has_sky = true;
        Ok(())
    }

    /// Adds the draws in order. If their geometry does not fit the working set at once, the earlier draws are
    /// submitted first, and their geometry makes room. Draws of other threads are waited for.
    fn add(&mut self, ids: &[DrawableId]) -> Result<(), GpuError> {
        self.depth_version += 1;
        let view = self.view.ok_or(GpuError::NotBegun(self.kind.name))?;
        // Cut or see-through drawables show their inside.
        let opaque = self.style == Style::default();
        let (mut rest, mut made_room) = (ids, false);
        let mut wait = Wait::new(self.scene.gpu().timeout());
        while !rest.is_empty() {
            self.places.clear();
            let absent = match self.kind.may_skip {
                None => Absent::Read,
                Some(most) => Absent::ReadOrSkip { most: most.saturating_sub(self.brought) },
            };
            let Self { scene, places, recording, draws, brought, hold, .. } = self;
            let others_hold = recording.measure(|| {
                let placing = scene.place(hold.id(), rest, absent, places)?;
                *brought += placing.bytes;
                draws.add(scene, &view, opaque, rest, places)?;
                Ok::<_, GpuError>(placing.others_hold)
            })?;
            let (placed, later) = rest.split_at(places.len().min(rest.len()));
            rest = later;
            if let Some(&first) = rest.first() {
                let is_full = placed.is_empty() && made_room;
                if is_full && !(others_hold && self.waits_for_others(first, &mut wait)) {
                    return Err(self.scene.too_small(first));
                }
                self.make_room()?;
                made_room = true;
            }
        }
        Ok(())
    }

    /// Waits until other passes have submitted the draws whose geometry they hold. False if that takes too
    /// long, or makes no room for the drawable.
    fn waits_for_others(&self, id: DrawableId, wait: &mut Wait) -> bool {
        if !self.scene.could_hold(id) {
            return false;
        }
        // All of this pass's draws are submitted: two that wait must not wait for each other.
        self.scene.end_draws(self.hold.id());
        while !self.scene.wait_for_others(self.hold.id(), SLICE) {
            if wait.slice(false, self.stream.is_cancelled()).is_some() {
                return false;
            }
        }
        true
    }

    /// Submits the added draws and waits for the device, so that none of the geometry is held any more.
    fn make_room(&mut self) -> Result<(), GpuError> {
        self.flush()?;
        let submitted = self.scene.set().submitted();
        // A signal comes after all earlier submissions, by other passes as well.
        self.stream.submit(self.kind.name, None, |_| {})?;
        self.stream.wait(self.kind.name)?;
        self.scene.set().release_all(&submitted);
        self.renew()
    }

    /// Holds later geometry, and releases earlier geometry: the device is done with it.
    fn renew(&mut self) -> Result<(), GpuError> {
        let buffer = {
            let mut set = self.scene.set();
            set.renew(self.hold.id())?;
            Arc::clone(set.buffer())
        };
        if !Arc::ptr_eq(&buffer, &self.geometry) {
            self.geometry = buffer;
            let layout = self.pipelines.layout();
            self.set = BindingSet::new(layout, &bound(self.kind, &self.sections, &self.geometry))?;
        }
        Ok(())
    }

    /// Submits the draws so far; the device starts on them at once. The first piece of a frame clears.
    pub(crate) fn flush(&mut self) -> Result<(), GpuError> {
        let view = self.view.as_ref().ok_or(GpuError::NotBegun(self.kind.name))?;
        let constants = CameraConstants::new(view);
        while self.fresh || self.draws.has_news() {
            let Self {
                stream,
                geometry,
                kind,
                pipelines,
                style,
                set,
                draws,
                attachments,
                recording,
                fresh,
                ..
            } = self;
            let pipeline = pipelines.get(*style)?;
            let clear = std::mem::replace(fresh, false);
            recording.measure(|| {
                stream.submit(kind.name, Some(Pass::Drawing), |commands| {
                    commands.render(attachments.targets(kind, clear), || {
                        commands.bind(pipeline, &constants);
                        commands.bind_set(pipeline, set);
                        if kind.fetch == Fetch::Fixed {
                            commands.bind_mesh(geometry);
                        }
                        draws.record(commands);
                    });
                })
            })?;
        }
        self.scene.end_draws(self.hold.id());
        Ok(())
    }

    /// Flushes, and waits for the device: other geometry may take the place of the frame's.
    pub(crate) fn complete(&mut self) -> Result<(), GpuError> {
        self.flush()?;
        self.stream.wait(self.kind.name)?;
        self.scene.release(self.hold.id());
        Ok(())
    }

    /// Completes the frame, and returns its times since `begin`.
    pub(crate) fn finish(&mut self) -> Result<PassTiming, GpuError> {
        self.complete()?;
        let device_ms = self.take_times()?.drawing_ns as f64 * 1e-6;
        Ok(PassTiming { device_ms, host_ms: self.recording.take_ms() })
    }

    /// Waits, and returns the device's times of all submissions since the last call or `begin`.
    pub(crate) fn take_times(&mut self) -> Result<DeviceTimes, GpuError> {
        self.stream.take_times(self.kind.name)
    }

    /// The same if the last wait was for all submissions. Otherwise no times, and those of all later.
    pub(crate) fn take_times_if_done(&mut self) -> Result<DeviceTimes, GpuError> {
        self.stream.take_times_if_done(self.kind.name)
    }

    /// The resources for an occlusion test over the pass's depth. Earlier draws are submitted first.
    pub(crate) fn over_depth(&mut self) -> Result<OverDepth<'_>, GpuError> {
        self.stream.check(self.kind.name)?;
        self.flush()?;
        Ok(self.unfinished_depth())
    }

    /// The same before the added draws, for work that does not read the depth.
    pub(crate) const fn unfinished_depth(&mut self) -> OverDepth<'_> {
        let Attachments { size, depth, .. } = &mut self.attachments;
        OverDepth { stream: &mut self.stream, size: *size, depth, version: self.depth_version }
    }

    /// Fills an acquired image of a window with the picture, after the added draws. Without draws it shows
    /// sky and ground.
    #[cfg(feature = "window")]
    pub(crate) fn fill_window(&mut self, acquired: &Acquired) -> Result<(), GpuError> {
        self.fill_sky()?;
        let attachments = &mut self.attachments;
        let Acquired { image, extent, available, filled, .. } = *acquired;
        let pass = Some(Pass::Drawing);
        self.stream.submit_between("showing a picture", pass, Some((available, filled)), |commands| {
            if let Some(colour) = &mut attachments.colour {
                commands.fill_window(colour, attachments.size, image, extent);
            }
        })
    }

    /// The depth on the host: copied from the device on the first call after drawing.
    pub(crate) fn read_depth(&mut self) -> Result<DepthImage<'_>, GpuError> {
        let version = Some(self.depth_version);
        if self.depth_on_host_version != version {
            self.flush()?;
            let Attachments { size, depth, .. } = &mut self.attachments;
            read_back(&mut self.stream, depth, *size, &mut self.depth_on_host)?;
            self.depth_on_host_version = version;
        }
        let depth = self.depth_on_host.as_ref().map(HostBuffer::elements).unwrap_or_default();
        DepthImage::new(self.size(), depth).map_err(|_| GpuError::NotBegun(self.kind.name))
    }

    /// The texels of the colour attachment, if the pass has one, copied into a buffer on the host.
    pub(crate) fn read_colour<'b, T: bytemuck::Pod>(
        &mut self,
        into: &'b mut Option<HostBuffer<T>>,
    ) -> Result<&'b [T], GpuError> {
        self.flush()?;
        let Attachments { size, colour, .. } = &mut self.attachments;
        let Some(colour) = colour else { return Ok(&[]) };
        read_back(&mut self.stream, colour, *size, into)
    }
}

/// Copies an image whose texels are `T`s into a host buffer, which is made anew if its size differs.
fn read_back<'b, T: bytemuck::Pod>(
    stream: &mut Stream,
    image: &mut Image,
    size: Viewport,
    into: &'b mut Option<HostBuffer<T>>,
) -> Result<&'b [T], GpuError> {
    const OPERATION: &str = "reading a picture back";
    let count = size.width() as usize * size.height() as usize;
    let (usage, location) = (vk::BufferUsageFlags::TRANSFER_DST, MemoryLocation::GpuToCpu);
    let make = || HostBuffer::new(image.gpu(), OPERATION, usage, location, count);
    let buffer = reuse_or_make(into, |buffer| buffer.len() == count, make)?;
    stream.submit(OPERATION, None, |commands| commands.copy_to_host(image, size, buffer.buffer()))?;
    stream.wait(OPERATION)?;
    Ok(buffer.elements())
}

/// The inputs of a pass's shaders.
fn bound<'b>(
    kind: &PassKind,
    sections: &'b HostBuffer<SectionPlanes>,
    geometry: &'b Buffer,
) -> Vec<&'b Buffer> {
    match kind.fetch {
        Fetch::Fixed => vec![sections.buffer()],
        Fetch::Pulled => vec![sections.buffer(), geometry],
    }
}

impl Attachments {
    fn new(gpu: &Arc<Gpu>, kind: &PassKind, size: Viewport) -> Result<Self, GpuError> {
        let depth = Image::new(gpu, "depth", vk::Format::D32_SFLOAT, size)?;
        let colour =
            kind.colour.map(|target| Image::new(gpu, "a picture", target.format, size)).transpose()?;
        Ok(Self { size, depth, colour })
    }

    fn targets(&mut self, kind: &PassKind, clear: bool) -> Targets<'_> {
        let colour = self.colour.as_mut().zip(kind.colour.map(|target| target.background));
        Targets { size: self.size, colour, depth: &mut self.depth, clear }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_scene::FlatObject;

    use crate::common::{CheckedGpu, ids, triangles, upload, view};
    use crate::{OccluderPass, PassTiming};

    #[test]
    fn a_frame_of_many_triangles_is_submitted_in_parts() {
        let Some(gpu) = CheckedGpu::open() else { return };
        // An eighth of a million triangles behind the eye, and one before it.
        let crowd = FlatObject {
            indices: [0, 1, 2].repeat(1 << 17),
            ..triangles(&[[0.0, 0.0, 9.0], [1.0, 0.0, 9.0], [0.0, 1.0, 9.0]])
        };
        let shown = triangles(&[[-9.0, -9.0, -2.0], [9.0, -9.0, -2.0], [0.0, 9.0, -2.0]]);
        let scene = upload(&gpu, &[crowd, shown]);
        let view = view(16, 16, DVec3::ZERO);
        let mut pass = OccluderPass::new(&scene, view.viewport()).unwrap();
        let [crowd, shown] = [ids(1)[0], ids(2)[1]];
        let mut depth_and_submissions = |ids: &[_]| {
            let before = pass.pass.stream.submissions();
            pass.begin(&view).unwrap();
            pass.draw(ids).unwrap();
            let timing: PassTiming = pass.finish().unwrap();
            let submissions = pass.pass.stream.submissions() - before;
            (pass.read_depth().unwrap().depth().to_vec(), submissions, timing)
        };
        let (expected, submissions, _) = depth_and_submissions(&[shown]);
        assert_eq!(submissions, 1);
        assert!(expected.iter().any(|&depth| depth > 0.0));
        // The visible one is in the first part: the second must not clear it.
        let (depth, submissions, _) = depth_and_submissions(&[&[shown][..], &[crowd; 8 * 17]].concat());
        assert_eq!((depth == expected, submissions), (true, 3));
        let (depth, submissions, _) = depth_and_submissions(&[crowd; 8 * 8]);
        assert_eq!((depth.iter().all(|&depth| depth == 0.0), submissions), (true, 1));
    }
}
