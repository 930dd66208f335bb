//! The properties of a kind of scene pass, and its pipelines.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

use ash::vk;

use crate::GpuError;
use crate::draw_record::Fetch;
use crate::layout::Layout;
use crate::pipeline::{DepthUse, Pipeline, PipelineDesc, Shader, VertexInput};
use crate::reuse::reuse_or_make;

/// The properties of a kind of scene pass.
pub(crate) struct PassKind {
    /// For error messages.
    pub(crate) name: &'static str,
    pub(crate) vertex: Shader,
    pub(crate) fragment: Option<Shader>,
    /// The fragment shader with sections.
    pub(crate) cut: Shader,
    /// Those for see-through drawables, without and with sections, if the pass draws such.
    pub(crate) see_through: Option<[Shader; 2]>,
    /// The vertex and fragment shaders that fill the picture's background; none for one colour.
    pub(crate) sky: Option<[Shader; 2]>,
    pub(crate) input: VertexInput,
    pub(crate) colour: Option<ColourTarget>,
    pub(crate) fetch: Fetch,
    /// After loading this many bytes of geometry for a frame, draws whose geometry is not on the device may
    /// be skipped; `None` if all must be drawn.
    pub(crate) may_skip: Option<u64>,
}

/// A pass's colour attachment.
#[derive(Clone, Copy)]
pub(crate) struct ColourTarget {
    pub(crate) format: vk::Format,
    pub(crate) background: vk::ClearColorValue,
}

/// The pipelines of one pass, each made on first use.
pub(crate) struct Pipelines {
    layout: Arc<Layout>,
    kind: &'static PassKind,
    made: HashMap<Style, Pipeline>,
    sky: Option<Pipeline>,
}

/// How a pass draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub(crate) struct Style {
    /// Sections cut something away.
    pub(crate) cut: bool,
    /// Draws see-through drawables.
    pub(crate) see_through: bool,
}

impl Pipelines {
    pub(crate) fn new(layout: Arc<Layout>, kind: &'static PassKind) -> Self {
        Self { layout, kind, made: HashMap::new(), sky: None }
    }

    pub(crate) const fn layout(&self) -> &Arc<Layout> {
        &self.layout
    }

    pub(crate) fn get(&mut self, style: Style) -> Result<&Pipeline, GpuError> {
        let Self { layout, kind, made, .. } = self;
        Ok(match made.entry(style) {
            Entry::Occupied(made) => made.into_mut(),
            Entry::Vacant(room) => room.insert(Pipeline::new(layout, &kind.desc(style))?),
        })
    }

    /// The background's pipeline, if this pass has one.
    pub(crate) fn sky(&mut self) -> Result<Option<&Pipeline>, GpuError> {
        let Self { layout, kind, sky, .. } = self;
        let Some([vertex, fragment]) = kind.sky else { return Ok(None) };
        let desc = PipelineDesc {
            vertex,
            fragment: Some(fragment),
            input: VertexInput::Nothing,
            colour: kind.colour.map(|target| target.format),
            depth: DepthUse::Test,
        };
        reuse_or_make(sky, |_| true, || Pipeline::new(layout, &desc)).map(|sky| Some(&*sky))
    }
}

impl PassKind {
    fn desc(&self, style: Style) -> PipelineDesc {
        let depth = match (self.colour, style) {
            (_, Style { see_through: true, .. }) => DepthUse::SeeThrough,
            (None, Style { cut: false, .. }) => DepthUse::Occlude,
            // The depth decides what sections cut: occluders need the picture's depth there.
            _ => DepthUse::Draw,
        };
        PipelineDesc {
            vertex: self.vertex,
            fragment: match (style, self.see_through) {
                (Style { see_through: true, cut }, Some([whole, in_part])) => {
                    Some(if cut { in_part } else { whole })
                }
                (Style { cut: true, .. }, _) => Some(self.cut),
                _ => self.fragment,
            },
            input: self.input,
            colour: self.colour.map(|target| target.format),
            depth,
        }
    }
}
