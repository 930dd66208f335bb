//! A camera with a number: for lanes on which cameras may be lost, repeated or overtaken.

use crate::{Camera, CameraError};

/// Counts the cameras that were published on a link, from 0; after the last number comes 0 again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct CameraNumber(pub u32);

/// A camera and its number on the link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NumberedCamera {
    /// The number.
    pub number: CameraNumber,
    /// The camera.
    pub camera: Camera,
}

impl CameraNumber {
    /// Whether this camera was published after `other`, in the order of serial numbers (RFC 1982): right as
    /// long as the two are fewer than 2^31 apart.
    #[must_use]
    pub const fn is_after(self, other: Self) -> bool {
        (self.0.wrapping_sub(other.0) as i32) > 0
    }

    /// The number of the next camera.
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0.wrapping_add(1))
    }
}

impl NumberedCamera {
    /// The size on the wire, in bytes.
    pub const SIZE: usize = 4 + Camera::SIZE;

    /// The 76 bytes that travel: the number as u32, little-endian, and the camera.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; Self::SIZE] {
        let mut bytes = [0; Self::SIZE];
        let (number, camera) = bytes.split_at_mut(4);
        number.copy_from_slice(&self.number.0.to_le_bytes());
        camera.copy_from_slice(&self.camera.to_bytes());
        bytes
    }

    /// Reads the 76 bytes.
    ///
    /// # Errors
    /// When the camera is none.
    pub fn from_bytes(bytes: &[u8; Self::SIZE]) -> Result<Self, CameraError> {
        let (mut number, mut camera) = ([0; 4], [0; Camera::SIZE]);
        number.copy_from_slice(&bytes[..4]);
        camera.copy_from_slice(&bytes[4..]);
        let camera = Camera::from_bytes(&camera)?;
        Ok(Self { number: CameraNumber(u32::from_le_bytes(number)), camera })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FrameNumber;

    #[test]
    fn the_order_goes_on_over_the_last_number() {
        let (last, first) = (CameraNumber(u32::MAX), CameraNumber(0));
        assert_eq!(last.next(), first);
        assert!(first.is_after(last) && !last.is_after(first) && !first.is_after(first));
        assert!(CameraNumber(7).is_after(CameraNumber(5)));
    }

    #[test]
    fn the_number_comes_first() {
        let camera = Camera::new([1.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(3)).unwrap();
        let numbered = NumberedCamera { number: CameraNumber(0x0403_0201), camera };
        let bytes = numbered.to_bytes();
        assert_eq!(bytes[..4], [1, 2, 3, 4]);
        assert_eq!(bytes[4..], camera.to_bytes());
        assert_eq!(NumberedCamera::from_bytes(&bytes), Ok(numbered));
    }
}
