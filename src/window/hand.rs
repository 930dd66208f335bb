//! A person's input: keys, the pointer and its wheel.

use glam::DVec3;
use winit::{
    dpi::PhysicalPosition,
    event::{ElementState, KeyEvent, MouseButton, MouseScrollDelta},
    keyboard::{KeyCode, ModifiersState, PhysicalKey},
};

use super::navigate::{Drag, Keys, Mode, Motion, Navigator};

/// Degrees of a step of the field of view.
const ZOOM: f64 = 5.0;
/// Pixels of a touchpad that count as one wheel step.
const STEP: f64 = 50.0;

/// The held keys, and the pointer's drag.
#[derive(Debug, Default)]
pub(super) struct Hand {
    keys: Keys,
    modifiers: ModifiersState,
    at: PhysicalPosition<f64>,
    /// The button of the drag.
    drags: Option<MouseButton>,
}

impl Hand {
    /// The pointer's position, pixels from the window's upper left.
    pub(super) const fn at(&self) -> PhysicalPosition<f64> {
        self.at
    }

    /// The keys' motion since the last call, and whether to move faster.
    pub(super) fn motion(&mut self) -> (Motion, bool) {
        (self.keys.motion(), self.keys.is_fast())
    }

    /// Whether a key that moves the eye is down.
    pub(super) fn holds_a_key(&self) -> bool {
        self.keys.is_any_held()
    }

    /// Sets the modifier keys, such as Control and Shift.
    pub(super) const fn holds(&mut self, modifiers: ModifiersState) {
        self.modifiers = modifiers;
    }

    /// The window has lost the keyboard.
    pub(super) fn lets_go(&mut self) {
        self.keys.release();
        self.drags = None;
    }

    /// A key went down or up. Returns whether to close the window.
    pub(super) fn presses(&mut self, key: &KeyEvent, navigator: &mut Navigator) -> bool {
        let PhysicalKey::Code(code) = key.physical_key else { return false };
        let is_down = key.state == ElementState::Pressed;
        let is_command = self
            .modifiers
            .intersects(ModifiersState::CONTROL.union(ModifiersState::SUPER).union(ModifiersState::ALT));
        if is_command && is_down {
            return self.modifiers.control_key() && matches!(code, KeyCode::KeyQ | KeyCode::KeyW);
        }
        if !self.keys.press(code, is_down) && is_down {
            match code {
                KeyCode::Digit1 => navigator.set_mode(Mode::Walk),
                KeyCode::Digit2 => navigator.set_mode(Mode::Fly),
                KeyCode::Digit3 => navigator.set_mode(Mode::Orbit),
                KeyCode::Minus => navigator.set_vfov(navigator.vfov_deg() + ZOOM),
                KeyCode::Equal => navigator.set_vfov(navigator.vfov_deg() - ZOOM),
                _ => {}
            }
        }
        false
    }

    /// A button went down over a point of the world, or up.
    pub(super) fn clicks(
        &mut self,
        button: MouseButton,
        state: ElementState,
        over: Option<DVec3>,
        navigator: &mut Navigator,
    ) {
        if state == ElementState::Pressed {
            navigator.begin_drag(over);
            self.drags = Some(button);
        } else if self.drags == Some(button) {
            self.drags = None;
        }
    }

    /// The pointer has moved, in a window of this height in pixels and this scale. Returns whether it drags
    /// something.
    pub(super) fn moves(
        &mut self,
        to: PhysicalPosition<f64>,
        (height, scale): (u32, f64),
        navigator: &mut Navigator,
    ) -> bool {
        let from = std::mem::replace(&mut self.at, to);
        let Some(button) = self.drags else { return false };
        let is_pan = button != MouseButton::Left || self.modifiers.shift_key();
        let drag = Drag { right: (to.x - from.x) / scale, down: (to.y - from.y) / scale, is_pan };
        navigator.drag(drag, f64::from(height) / scale);
        true
    }

    /// The wheel was turned over a point of the world.
    pub(super) fn turns(&self, delta: MouseScrollDelta, over: Option<DVec3>, navigator: &mut Navigator) {
        let steps = match delta {
            MouseScrollDelta::LineDelta(_, lines) => f64::from(lines),
            MouseScrollDelta::PixelDelta(pixels) => pixels.y / STEP,
        };
        if over.is_some() && self.drags.is_none() {
            navigator.begin_drag(over);
        }
        navigator.wheel(steps);
    }
}
