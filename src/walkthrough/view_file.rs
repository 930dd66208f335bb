//! A file of view states: changes with their frames.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use serde::Deserialize;
use thiserror::Error;
use trimaran_proto::{
    LodRule, LodRuleError, ObjectSet, OcclusionTestKind, Section, SectionBox, SectionError, SectionPlane,
    Sections, SettingsError, ViewState, ViewStateError, ViewVersion, Viewport,
};
use trimaran_scene::Scene;

use super::view_states::{ViewChange, ViewStates};

/// The file's format. Settings that a change does not name stay as they were.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewFile {
    #[serde(default)]
    change: Vec<Change>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Change {
    frame: u32,
    size: Option<[u32; 2]>,
    epsilon: Option<f64>,
    occlusion_test: Option<String>,
    sections: Option<Vec<Cut>>,
    hidden: Option<Vec<Object>>,
    isolated: Option<Vec<Object>>,
    see_through: Option<Vec<Object>>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(untagged, deny_unknown_fields, expecting = "give `point` and `cut_towards`, or `min` and `max`")]
enum Cut {
    Plane { point: [f64; 3], cut_towards: [f64; 3] },
    Box { min: [f64; 3], max: [f64; 3] },
}

/// An object by its number, or all of a name. A name ending with `*` stands for all that begin so.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "give the number of an object or a name")]
enum Object {
    Number(u32),
    Name(String),
}

/// Why a file of view states cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ViewFileError {
    /// The file cannot be read.
    #[error("cannot read the view states {path}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        #[source]
        cause: std::io::Error,
    },
    /// It is not a valid file of view states.
    #[error("{path} is no file of view states", path = path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The error, and its position.
        #[source]
        cause: toml::de::Error,
    },
    /// A change is invalid.
    #[error("change {number} of {path} (frame {frame}) cannot be", path = path.display())]
    Change {
        /// The file.
        path: PathBuf,
        /// Its number in the file, counted from 1.
        number: usize,
        /// Its frame.
        frame: u32,
        /// The cause.
        #[source]
        cause: ViewChangeError,
    },
}

/// Why a view state is invalid.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ViewChangeError {
    /// The frames do not ascend.
    #[error("its frame must come after that of the change before it")]
    Order,
    /// A setting is outside its range.
    #[error(transparent)]
    Setting(#[from] SettingsError),
    /// The error bound is invalid.
    #[error(transparent)]
    Epsilon(#[from] LodRuleError),
    /// Stopping at few pixels needs an occlusion test that counts them.
    #[error("stopping at few pixels needs the occlusion test query or raster")]
    FewPixels,
    /// A section is invalid.
    #[error("section {number} cannot be")]
    Section {
        /// Its number in the change, counted from 1.
        number: usize,
        /// The cause.
        #[source]
        cause: SectionError,
    },
    /// There are too many sections.
    #[error(transparent)]
    Sections(SectionError),
    /// No object has this number.
    #[error("there is no object {number}: the scene has {count}, counted from 0")]
    Number {
        /// The number.
        number: u32,
        /// How many objects there are.
        count: usize,
    },
    /// No object has this name.
    #[error(
        "no object is called {0:?}; `trimaran run --visible` names objects, and `NAME*` stands for all that begin so"
    )]
    Name(String),
    /// It is too long to be sent.
    #[error(transparent)]
    TooLong(#[from] ViewStateError),
}

impl ViewStates {
    /// Reads the changes of a walk through `scene` that begins with the view state `first`.
    ///
    /// # Errors
    /// The error in the file, and its position.
    pub fn read(path: &Path, scene: &Scene, first: ViewState) -> Result<Self, ViewFileError> {
        let read = |cause| ViewFileError::Read { path: path.to_owned(), cause };
        let text = std::fs::read_to_string(path).map_err(read)?;
        let syntax = |cause| ViewFileError::Syntax { path: path.to_owned(), cause };
        let file: ViewFile = toml::from_str(&text).map_err(syntax)?;
        let mut later = Vec::<ViewChange>::new();
        let mut state = first.clone();
        let mut before = None;
        for (number, change) in (1..).zip(&file.change) {
            let frame = change.frame;
            let failed = |cause| ViewFileError::Change { path: path.to_owned(), number, frame, cause };
            if before.replace(frame).is_some_and(|before| before >= frame) {
                return Err(failed(ViewChangeError::Order));
            }
            state = change.made_to(state, scene).map_err(failed)?;
            later.push(ViewChange { pose: frame, state: Arc::new(state.clone()) });
        }
        Ok(Self::new(first, later))
    }
}

impl Change {
    /// Applies this change to `state`.
    fn made_to(&self, mut state: ViewState, scene: &Scene) -> Result<ViewState, ViewChangeError> {
        let Self { frame: _, size, epsilon, occlusion_test, sections, hidden, isolated, see_through } = self;
        if let Some([width, height]) = *size {
            state.viewport = Viewport::new(width, height)?;
        }
        if let Some(epsilon) = *epsilon {
            state.lod = LodRule::new(epsilon)?.stopping_at_few_pixels(state.lod.stops_at_few_pixels());
        }
        if let Some(test) = occlusion_test {
            state.occlusion_test = test.parse()?;
        }
        if state.lod.stops_at_few_pixels() && state.occlusion_test == OcclusionTestKind::Hzb {
            return Err(ViewChangeError::FewPixels);
        }
        if let Some(cuts) = sections {
            let section = |(number, cut): (usize, &Cut)| {
                cut.section().map_err(|cause| ViewChangeError::Section { number, cause })
            };
            let sections: Vec<Section> = (1..).zip(cuts).map(section).collect::<Result<_, _>>()?;
            state.sections = Sections::new(&sections).map_err(ViewChangeError::Sections)?;
        }
        if let Some(objects) = hidden {
            state.hidden = objects_of(scene, objects)?;
        }
        if let Some(objects) = isolated {
            // An empty set isolates nothing: all is shown again.
            state.isolated = Some(objects_of(scene, objects)?).filter(|set| !set.is_empty());
        }
        if let Some(objects) = see_through {
            state.see_through = Some(objects_of(scene, objects)?);
        }
        state.to_messages(ViewVersion(0))?;
        Ok(state)
    }
}

impl Cut {
    fn section(self) -> Result<Section, SectionError> {
        Ok(match self {
            Self::Plane { point, cut_towards } => Section::Plane(SectionPlane::new(point, cut_towards)?),
            Self::Box { min, max } => Section::Box(SectionBox::new(min, max)?),
        })
    }
}

fn objects_of(scene: &Scene, objects: &[Object]) -> Result<ObjectSet, ViewChangeError> {
    let count = scene.objects().len();
    let mut chosen = Vec::new();
    for object in objects {
        match object {
            Object::Number(number) if (*number as usize) < count => chosen.push(*number),
            Object::Number(number) => return Err(ViewChangeError::Number { number: *number, count }),
            Object::Name(name) => {
                let before = chosen.len();
                let is_meant = |called: &str| match name.strip_suffix('*') {
                    Some(start) => called.starts_with(start),
                    None => called == name,
                };
                let all = (0..).take(count);
                chosen.extend(all.filter(|object| scene.object_name(*object).is_some_and(is_meant)));
                if chosen.len() == before {
                    return Err(ViewChangeError::Name(name.clone()));
                }
            }
        }
    }
    Ok(chosen.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use trimaran_cook::{
        CookOptions, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_proto::Settings;
    use trimaran_transport::causes;

    use super::*;

    fn scene() -> Scene {
        cook(&plant(&PlantOptions::small(1)), &CookOptions::default(), &()).unwrap()
    }

    fn first() -> ViewState {
        Settings::new(Viewport::new(64, 48).unwrap(), LodRule::new(2.0).unwrap()).into()
    }

    fn read(text: &str) -> Result<ViewStates, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        let read = ViewStates::read(file.path(), &scene(), first());
        read.map_err(|error| causes(&error).replace(&file.path().display().to_string(), "FILE"))
    }

    #[test]
    fn each_change_is_made_to_what_was_before() {
        let states = read(
            "[[change]]
            frame = 3
            size = [80, 60]
            hidden = [1, 2]
            sections = [{ point = [0, 0, 0], cut_towards = [0, 0, 2] }, { min = [0, 0, 0], max = [1, 2, 3] }]
            [[change]]
            frame = 9
            epsilon = 4.5
            occlusion_test = \"query\"
            hidden = []
            isolated = [0]
            see_through = [5, 4]",
        )
        .unwrap();
        let [one, two] = states.later() else { panic!("{states:?}") };
        let plane = Section::Plane(SectionPlane::new([0.0; 3], [0.0, 0.0, 1.0]).unwrap());
        let kept = Section::Box(SectionBox::new([0.0; 3], [1.0, 2.0, 3.0]).unwrap());
        let expected = ViewState {
            viewport: Viewport::new(80, 60).unwrap(),
            hidden: [1, 2].into_iter().collect(),
            sections: Sections::new(&[plane, kept]).unwrap(),
            ..first()
        };
        assert_eq!((one.pose, &*one.state), (3, &expected));
        let expected = ViewState {
            lod: LodRule::new(4.5).unwrap(),
            occlusion_test: OcclusionTestKind::Query,
            hidden: ObjectSet::default(),
            isolated: Some([0].into_iter().collect()),
            see_through: Some([4, 5].into_iter().collect()),
            ..expected
        };
        assert_eq!((two.pose, &*two.state), (9, &expected));
        assert_eq!(read("").unwrap().later(), []);
    }

    #[test]
    fn objects_are_known_by_name_and_by_how_names_begin() {
        let scene = scene();
        let names: Vec<_> = (0..).map_while(|object| scene.object_name(object)).collect();
        let name = names.iter().copied().find(|name| !name.is_empty()).unwrap();
        let start: String = name.chars().take(1).collect();
        let of = |text: String| objects_of(&scene, &[Object::Name(text)]).unwrap();
        let called = |is: &dyn Fn(&str) -> bool| -> ObjectSet {
            (0..).zip(&names).filter(|(_, name)| is(name)).map(|(object, _)| object).collect()
        };
        assert_eq!(of(name.to_owned()), called(&|other| other == name));
        assert_eq!(of(format!("{start}*")), called(&|other| other.starts_with(&start)));
        assert_eq!(of("*".to_owned()).len(), names.len());
    }

    #[test]
    fn what_cannot_be_is_named_with_its_place() {
        for (text, expected) in [
            ("[[change]]\nframe = -1", "FILE is no file of view states"),
            ("[[change]]\nframe = 1\ncolour = 3", "unknown field `colour`"),
            ("[[change]]\nframe = 1\nsections = [{ min = [0, 0, 0] }]", "give `point` and `cut_towards`"),
            ("[[change]]\nframe = 1\n[[change]]\nframe = 1", "change 2 of FILE (frame 1) cannot be"),
            ("[[change]]\nframe = 1\nsize = [0, 1]", "0x1 pixels has a side outside"),
            ("[[change]]\nframe = 1\nepsilon = 0.0", "an error bound of 0 pixels"),
            ("[[change]]\nframe = 1\nocclusion_test = \"x\"", "no occlusion test is called \"x\""),
            (
                "[[change]]\nframe = 1\nsections = [{ min = [0, 0, 0], max = [0, 1, 1] }]",
                "section 1 cannot be: the section box is empty",
            ),
            ("[[change]]\nframe = 1\nhidden = [99999]", "there is no object 99999: the scene has"),
            ("[[change]]\nframe = 1\nisolated = [\"no such\"]", "no object is called \"no such\""),
        ] {
            let said = read(text).unwrap_err();
            assert!(said.contains(expected), "{said}");
        }
        let missing = ViewStates::read(Path::new("/no/such/file"), &scene(), first()).unwrap_err();
        assert!(missing.to_string().contains("/no/such/file"), "{missing}");
    }
}
