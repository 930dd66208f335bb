//! A person's motion, by keys.

use std::collections::HashSet;

use winit::keyboard::KeyCode;

/// From -1 to 1 each, or more if several keys add up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Forwards.
    pub ahead: f64,
    /// Sideways.
    pub right: f64,
    /// Upwards.
    pub up: f64,
    /// To the left.
    pub turn: f64,
    /// Upward tilt of the view.
    pub tilt: f64,
}

/// The held keys, by their position on the keyboard.
#[derive(Debug, Default)]
pub struct Keys {
    held: HashSet<KeyCode>,
    /// Keys pressed since the last read: a tap between two pictures moves as well.
    tapped: HashSet<KeyCode>,
}

impl Keys {
    /// A key went down or up. Returns whether it moves the eye.
    pub fn press(&mut self, key: KeyCode, is_down: bool) -> bool {
        if motion_of(key).is_none() && !FASTER.contains(&key) {
            return false;
        }
        if is_down {
            self.held.insert(key);
            self.tapped.insert(key);
        } else {
            self.held.remove(&key);
        }
        true
    }

    /// All keys are up: the window has lost the keyboard.
    pub fn release(&mut self) {
        self.held.clear();
        self.tapped.clear();
    }

    /// Whether the eye is to move faster.
    #[must_use]
    pub fn is_fast(&self) -> bool {
        FASTER.iter().any(|key| self.held.contains(key))
    }

    /// Whether a key that moves the eye is down.
    #[must_use]
    pub fn is_any_held(&self) -> bool {
        self.held.iter().any(|key| !FASTER.contains(key))
    }

    /// The keys' motion since the last call.
    pub fn motion(&mut self) -> Motion {
        let keys = self.held.union(&self.tapped).filter_map(|&key| motion_of(key));
        let motion = keys.fold(Motion::default(), |sum, one| Motion {
            ahead: sum.ahead + one.ahead,
            right: sum.right + one.right,
            up: sum.up + one.up,
            turn: sum.turn + one.turn,
            tilt: sum.tilt + one.tilt,
        });
        self.tapped.clear();
        motion
    }
}

const FASTER: [KeyCode; 2] = [KeyCode::ShiftLeft, KeyCode::ShiftRight];

/// The motion of a held key.
fn motion_of(key: KeyCode) -> Option<Motion> {
    let still = Motion::default();
    Some(match key {
        KeyCode::KeyW | KeyCode::ArrowUp => Motion { ahead: 1.0, ..still },
        KeyCode::KeyS | KeyCode::ArrowDown => Motion { ahead: -1.0, ..still },
        KeyCode::KeyD => Motion { right: 1.0, ..still },
        KeyCode::KeyA => Motion { right: -1.0, ..still },
        KeyCode::KeyE | KeyCode::Space => Motion { up: 1.0, ..still },
        KeyCode::KeyQ | KeyCode::KeyC => Motion { up: -1.0, ..still },
        KeyCode::ArrowLeft => Motion { turn: 1.0, ..still },
        KeyCode::ArrowRight => Motion { turn: -1.0, ..still },
        KeyCode::PageUp => Motion { tilt: 1.0, ..still },
        KeyCode::PageDown => Motion { tilt: -1.0, ..still },
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_say_what_a_person_wants() {
        let mut keys = Keys::default();
        assert!(keys.press(KeyCode::KeyW, true) && keys.press(KeyCode::ShiftLeft, true));
        assert!(!keys.press(KeyCode::KeyX, true));
        assert!(keys.is_fast() && keys.is_any_held());
        assert_eq!(keys.motion(), Motion { ahead: 1.0, ..Motion::default() });
        keys.press(KeyCode::KeyS, true);
        keys.press(KeyCode::KeyD, true);
        assert_eq!(keys.motion(), Motion { right: 1.0, ..Motion::default() }, "ahead and back at once");
        keys.release();
        assert!(!keys.is_fast() && !keys.is_any_held());
        assert_eq!(keys.motion(), Motion::default());
    }

    #[test]
    fn who_taps_a_key_between_two_pictures_moves_once() {
        let mut keys = Keys::default();
        keys.press(KeyCode::ArrowLeft, true);
        keys.press(KeyCode::ArrowLeft, false);
        assert_eq!(keys.motion(), Motion { turn: 1.0, ..Motion::default() });
        assert_eq!(keys.motion(), Motion::default());
    }
}
