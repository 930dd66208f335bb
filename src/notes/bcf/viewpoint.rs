//! Views as the viewpoints of BCF (`VisualizationInfo`).

use super::{
    super::{Camera, Frame, Guid, Lens, PartRef, Section, View, Visibility},
    BcfError, BcfVersion,
    xml::Element,
};

/// Directions that differ by less are the same: an axis that was turned and back.
const ROUNDING: f64 = 1e-9;
/// The aspect of a picture that does not say it, as BCF 3.0 advises.
const SQUARE: f64 = 1.0;
/// The sides of a box in the order in which they are written.
const SIDES: [[f64; 3]; 6] =
    [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, 0.0, 1.0]];

/// The document of a view. Parts are named by `told`.
pub(super) fn write(
    view: &View,
    version: BcfVersion,
    frame: &Frame,
    told: impl Fn(&[PartRef]) -> Vec<PartRef>,
) -> Element {
    let mut root = Element::new("VisualizationInfo").with("Guid", view.guid.to_string());
    let Visibility { default, exceptions } = &view.visibility;
    let list = |name: &str, parts: &[PartRef]| {
        let mut list = Element::new(name);
        list.children = told(parts).iter().map(component).collect();
        list
    };
    let mut components = Element::new("Components");
    if !view.selected.is_empty() {
        components.add(list("Selection", &view.selected));
    }
    let mut visibility = Element::new("Visibility").with("DefaultVisibility", default.to_string());
    if !exceptions.is_empty() {
        visibility.add(list("Exceptions", exceptions));
    }
    components.add(visibility);
    root.add(components);
    root.children.extend(view.camera.as_ref().map(|camera| write_camera(camera, version, frame)));
    if !view.sections.is_empty() {
        let mut planes = Element::new("ClippingPlanes");
        for (location, direction) in view.sections.iter().flat_map(planes_of) {
            let mut plane = Element::new("ClippingPlane");
            plane.add(vector("Location", frame.to_bcf(location)));
            plane.add(vector("Direction", frame.direction_to_bcf(direction)));
            planes.add(plane);
        }
        root.add(planes);
    }
    root
}

fn write_camera(camera: &Camera, version: BcfVersion, frame: &Frame) -> Element {
    let Camera { eye, forward, up, lens, aspect } = *camera;
    let (name, lens, number) = match lens {
        Lens::VfovDeg(degrees) => ("PerspectiveCamera", "FieldOfView", degrees),
        Lens::Height(metres) => ("OrthogonalCamera", "ViewToWorldScale", metres),
    };
    let mut camera = Element::new(name);
    camera.add(vector("CameraViewPoint", frame.to_bcf(eye)));
    camera.add(vector("CameraDirection", frame.direction_to_bcf(forward)));
    camera.add(vector("CameraUpVector", frame.direction_to_bcf(up)));
    camera.add(Element::leaf(lens, number.to_string()));
    if version == BcfVersion::V3 {
        camera.add(Element::leaf("AspectRatio", aspect.to_string()));
    }
    camera
}

fn component(part: &PartRef) -> Element {
    let mut component = Element::new("Component");
    if let Some(guid) = &part.ifc_guid {
        component = component.with("IfcGuid", guid);
    }
    let texts = [("OriginatingSystem", &part.system), ("AuthoringToolId", &part.id)];
    let filled = texts.into_iter().filter_map(|(name, text)| Some((name, text.as_deref()?)));
    let filled = filled.filter(|(_, text)| !text.trim().is_empty());
    component.children = filled.map(|(name, text)| Element::leaf(name, text)).collect();
    component
}

fn vector(name: &str, numbers: [f64; 3]) -> Element {
    let mut vector = Element::new(name);
    vector.children = ["X", "Y", "Z"]
        .iter()
        .zip(numbers)
        .map(|(axis, number)| Element::leaf(axis, number.to_string()))
        .collect();
    vector
}

/// The planes of a section, each with the direction of what it cuts away.
fn planes_of(section: &Section) -> Vec<([f64; 3], [f64; 3])> {
    match *section {
        Section::Plane { point, direction } => vec![(point, direction)],
        Section::Box { lower, upper } => {
            let corner = |side: usize| if side.is_multiple_of(2) { lower } else { upper };
            SIDES.iter().enumerate().map(|(side, direction)| (corner(side), *direction)).collect()
        }
    }
}

/// Planes as sections: six one behind the other that are a box become one.
fn sections_of(planes: &[([f64; 3], [f64; 3])]) -> Vec<Section> {
    let (mut sections, mut rest) = (Vec::new(), planes);
    while let Some((&(point, direction), others)) = rest.split_first() {
        match rest.split_first_chunk().and_then(|(six, others)| Some((box_of(six)?, others))) {
            Some((section, behind)) => {
                sections.push(section);
                rest = behind;
            }
            None => {
                sections.push(Section::Plane { point, direction });
                rest = others;
            }
        }
    }
    sections
}

fn box_of(planes: &[([f64; 3], [f64; 3]); 6]) -> Option<Section> {
    let is_same = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < ROUNDING);
    if !planes.iter().zip(SIDES).all(|((_, direction), side)| is_same(*direction, side)) {
        return None;
    }
    let [west, east, below, above, north, south] = planes.map(|(point, _)| point);
    let [lower, upper] = [[west[0], below[1], north[2]], [east[0], above[1], south[2]]];
    lower.iter().zip(upper).all(|(low, high)| *low < high).then_some(Section::Box { lower, upper })
}

/// The view in a document; `guid` is that of a document without one.
pub(super) fn read(root: &Element, entry: &str, guid: Guid, frame: &Frame) -> Result<View, BcfError> {
    let reading = Reading { entry, frame };
    let camera = match (root.child("PerspectiveCamera"), root.child("OrthogonalCamera")) {
        (Some(camera), _) => Some(reading.camera(camera, "FieldOfView", Lens::VfovDeg)?),
        (None, Some(camera)) => Some(reading.camera(camera, "ViewToWorldScale", Lens::Height)?),
        (None, None) => None,
    };
    let mut planes = Vec::new();
    for plane in root.all("ClippingPlanes").flat_map(|planes| planes.all("ClippingPlane")) {
        let location = reading.vector(plane, "Location")?;
        let direction = reading.vector(plane, "Direction")?;
        planes.push((frame.to_scene(location), frame.direction_to_scene(direction)));
    }
    let components = root.child("Components");
    let selected = components.and_then(|components| components.child("Selection"));
    let visibility = components.and_then(|components| components.child("Visibility"));
    let exceptions =
        visibility.and_then(|visibility| visibility.child("Exceptions")).map(parts).unwrap_or_default();
    let default = visibility.and_then(|visibility| visibility.attribute("DefaultVisibility")).map(str::trim);
    // Nothing but nothing is what no view means.
    let default = matches!(default, Some("true" | "1")) || exceptions.is_empty();
    Ok(View {
        guid,
        camera,
        sections: sections_of(&planes),
        selected: selected.map(parts).unwrap_or_default(),
        visibility: Visibility { default, exceptions },
        see_through: None,
        snapshot: None,
    })
}

fn parts(list: &Element) -> Vec<PartRef> {
    let text = |component: &Element, name: &str| {
        component.child(name).map(|text| text.text.clone()).filter(|text| !text.trim().is_empty())
    };
    let part = |component: &Element| PartRef {
        ifc_guid: component.attribute("IfcGuid").map(str::to_owned),
        system: text(component, "OriginatingSystem"),
        id: text(component, "AuthoringToolId"),
    };
    list.all("Component").map(part).collect()
}

/// A document that is read.
struct Reading<'r> {
    entry: &'r str,
    frame: &'r Frame,
}

impl Reading<'_> {
    fn camera(
        &self,
        camera: &Element,
        lens: &'static str,
        make: impl FnOnce(f64) -> Lens,
    ) -> Result<Camera, BcfError> {
        let aspect = match camera.child("AspectRatio") {
            Some(_) => self.number(camera, "AspectRatio")?,
            None => SQUARE,
        };
        let forward = self.frame.direction_to_scene(self.vector(camera, "CameraDirection")?);
        let up = self.frame.direction_to_scene(self.vector(camera, "CameraUpVector")?);
        // Some programs leave it out where it is plain.
        let up = if up == [0.0; 3] { [0.0, 1.0, 0.0] } else { up };
        let eye = self.frame.to_scene(self.vector(camera, "CameraViewPoint")?);
        Ok(Camera { eye, forward, up, lens: make(self.number(camera, lens)?), aspect })
    }

    fn vector(&self, element: &Element, name: &'static str) -> Result<[f64; 3], BcfError> {
        let vector = element.child(name).ok_or_else(|| self.wrong(name, "is missing".to_owned()))?;
        Ok([self.number(vector, "X")?, self.number(vector, "Y")?, self.number(vector, "Z")?])
    }

    fn number(&self, element: &Element, name: &'static str) -> Result<f64, BcfError> {
        let text = element.child(name).ok_or_else(|| self.wrong(name, "is missing".to_owned()))?.text.trim();
        let number = text.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.wrong(name, format!("is {text:?}, which is no number")))
    }

    fn wrong(&self, element: &'static str, why: String) -> BcfError {
        BcfError::Element { entry: self.entry.to_owned(), element, why }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_six_planes_and_a_box_again() {
        let section = Section::Box { lower: [-1.0, -2.0, -3.0], upper: [4.0, 5.0, 6.0] };
        let plane = Section::Plane { point: [0.0; 3], direction: [-1.0, 0.0, 0.0] };
        let all = [plane, section, plane];
        let planes: Vec<_> = all.iter().flat_map(planes_of).collect();
        assert_eq!(planes.len(), 8);
        assert_eq!(sections_of(&planes), all);
        // Each cuts away the outside.
        for (point, direction) in planes_of(&section) {
            let beyond = point.iter().zip(direction).map(|(at, way)| at * way).sum::<f64>();
            let middle = [1.5, 1.5, 1.5].iter().zip(direction).map(|(at, way)| at * way).sum::<f64>();
            assert!(beyond > middle, "{direction:?}");
        }
        // An axis may be off by rounding.
        for (off, sections) in [(1e-10, 1), (1e-8, 6)] {
            let mut planes = planes_of(&section);
            planes[3].1[0] += off;
            assert_eq!(sections_of(&planes).len(), sections, "{off}");
        }
        // Planes that leave nothing are no box.
        let empty: Vec<_> = planes_of(&Section::Box { lower: [4.0; 3], upper: [-1.0; 3] });
        assert_eq!(sections_of(&empty).len(), 6);
    }
}
