//! The window's title: its one line of text.

use std::time::Duration;

use super::navigate::Navigator;

/// The shortest time between updates while the eye moves.
const PERIOD: Duration = Duration::from_millis(250);

/// The title's state.
#[derive(Debug, Default)]
pub(super) struct Title {
    says: String,
    /// Since when, and how many pictures were drawn since then.
    at: Duration,
    pictures: u32,
}

impl Title {
    /// A picture was drawn; the eye has moved or rests. Returns a new title if it changes.
    pub(super) fn drawn(
        &mut self,
        name: &str,
        navigator: &Navigator,
        now: Duration,
        has_moved: bool,
    ) -> Option<&str> {
        self.pictures += 1;
        let since = now.saturating_sub(self.at);
        if has_moved && since < PERIOD {
            return None;
        }
        let eye = navigator.pose().eye;
        let (mode, speed) = (navigator.mode().name(), navigator.speed());
        let mut says =
            format!("{name}: {mode} at {speed:.2} m/s, eye at {:.2} {:.2} {:.2}", eye.x, eye.y, eye.z);
        if has_moved {
            says += &format!(", {:.0} pictures a second", f64::from(self.pictures) / since.as_secs_f64());
        }
        (self.at, self.pictures) = (now, 0);
        if says == self.says {
            return None;
        }
        self.says = says;
        Some(&self.says)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::navigate::Start;
    use super::*;

    #[test]
    fn a_title_says_where_the_eye_is_a_few_times_a_second_and_where_it_rests() {
        let (eye, forward) = (DVec3::new(1.0, 1.7, -2.0), DVec3::NEG_Z);
        let start = Start { eye, forward, eye_height: 1.7, has_floors: true, vfov_deg: 60.0 };
        let mut navigator = Navigator::new(&start);
        let mut title = Title::default();
        let mut drawn = |navigator: &Navigator, ms: u64, has_moved: bool| {
            title.drawn("plant", navigator, Duration::from_millis(ms), has_moved).map(str::to_owned)
        };
        let rests = "plant: walking at 1.40 m/s, eye at 1.00 1.70 -2.00";
        assert_eq!(drawn(&navigator, 10, false).as_deref(), Some(rests));
        assert_eq!(drawn(&navigator, 20, false), None, "it says so already");
        navigator.go_to(DVec3::new(3.0, 1.7, -2.0), forward);
        assert_eq!(drawn(&navigator, 120, true), None, "it was told a moment ago");
        let moves = "plant: walking at 1.40 m/s, eye at 3.00 1.70 -2.00, 4 pictures a second";
        assert_eq!(drawn(&navigator, 520, true).as_deref(), Some(moves));
        assert_eq!(drawn(&navigator, 530, false).as_deref(), moves.strip_suffix(", 4 pictures a second"));
    }
}
