//! Coordinate frames of the KlaskTron stack and their transforms into the board frame.
//!
//! With `S` and `L` the short and the long side of the field:
//!
//! | frame | x in board | y in board | determinant |
//! |---|---|---|---|
//! | `Image` (ROS topics; x right along the long side, y down) | `y_img - S/2` | `x_img - L/2` | -1 |
//! | `Sim` (policies, sprite renderer) | `x_sim` | `y_sim` | +1 |
//! | `SimMirrored` (newer upstream dataset builder, `x_sim = S/2 - y_img`) | `-x_sim` | `y_sim` | -1 |
//!
//! The image frame is left-handed seen from above (its z axis points down), hence its -1. Source:
//! the upstream policy node, sprite renderer and dataset builder, which disagree on the sign of the
//! lateral axis. The board's size is a parameter, never a constant: recordings made with 0.42 m and
//! with 0.44 m exist.

/// Size of the playing field (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoardSize {
    /// Short side, across (m); 0.32 by default.
    pub short_side: f64,
    /// Long side, from goal to goal (m); 0.42 by default, 0.44 in older software.
    pub long_side: f64,
}

impl Default for BoardSize {
    fn default() -> Self {
        Self::STANDARD
    }
}

/// Error: a board size outside the allowed range.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "a board of {short_side} m x {long_side} m: both sides must lie above 0 and up to 10 m; \
     the KlaskTron board is 0.32 m x 0.42 m"
)]
pub struct BoardSizeError {
    /// Short side (m).
    pub short_side: f64,
    /// Long side (m).
    pub long_side: f64,
}

impl BoardSize {
    /// Size of the KlaskTron board.
    pub const STANDARD: Self = Self { short_side: 0.32, long_side: 0.42 };

    /// Create a board of `short_side` by `long_side` (m).
    ///
    /// # Errors
    /// When a side is not in (0, 10] m.
    pub fn new(short_side: f64, long_side: f64) -> Result<Self, BoardSizeError> {
        let fits = |side: f64| 0.0 < side && side <= 10.0;
        if fits(short_side) && fits(long_side) {
            Ok(Self { short_side, long_side })
        } else {
            Err(BoardSizeError { short_side, long_side })
        }
    }
}

/// Coordinate frame of recorded positions and velocities on the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// All ROS topics: origin at the top left corner, x right along the long side, y down.
    Image,
    /// The board frame itself, as the policies use it.
    Sim,
    /// The simulator frame with its lateral axis mirrored, as the newer dataset builder wrote it.
    SimMirrored,
}

impl Frame {
    /// Transform a position (m) of this frame into the board frame (m).
    #[must_use]
    pub fn position_in_board(self, size: BoardSize, position: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.velocity_in_board(position);
        let [x0, y0] = self.origin_shift(size);
        [x - x0, y - y0]
    }

    /// Transform a velocity (m/s) of this frame into the board frame (m/s).
    #[must_use]
    pub fn velocity_in_board(self, velocity: [f64; 2]) -> [f64; 2] {
        let [x, y] = velocity;
        match self {
            Self::Image => [y, x],
            Self::Sim => [x, y],
            Self::SimMirrored => [-x, y],
        }
    }

    /// Transform a position in the board frame (m) into this frame (m).
    #[must_use]
    pub fn position_from_board(self, size: BoardSize, position: [f64; 2]) -> [f64; 2] {
        let [x0, y0] = self.origin_shift(size);
        self.velocity_from_board([position[0] + x0, position[1] + y0])
    }

    /// Transform a velocity in the board frame (m/s) into this frame (m/s).
    #[must_use]
    pub fn velocity_from_board(self, velocity: [f64; 2]) -> [f64; 2] {
        // Each of the three maps is its own inverse: a swap, the identity, a mirror.
        self.velocity_in_board(velocity)
    }

    /// Return the offset of the field's centre from this frame's origin, along the board's axes (m).
    fn origin_shift(self, size: BoardSize) -> [f64; 2] {
        match self {
            Self::Image => [size.short_side / 2.0, size.long_side / 2.0],
            Self::Sim | Self::SimMirrored => [0.0, 0.0],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: [Frame; 3] = [Frame::Image, Frame::Sim, Frame::SimMirrored];

    fn assert_close(found: [f64; 2], expected: [f64; 2]) {
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-15, "{found:?} against {expected:?}");
        }
    }

    #[test]
    fn there_and_back_is_where_one_was() {
        let size = BoardSize { short_side: 0.32, long_side: 0.44 };
        for frame in FRAMES {
            for point in [[0.013, -0.2], [0.1, 0.07], [-0.16, 0.22]] {
                let inside = frame.position_in_board(size, point);
                assert_close(frame.position_from_board(size, inside), point);
                let velocity = frame.velocity_in_board(point);
                assert_close(frame.velocity_from_board(velocity), point);
            }
        }
    }

    #[test]
    fn determinants_tell_turns_from_mirrors() {
        let determinant = |frame: Frame| {
            let [a, c] = frame.velocity_in_board([1.0, 0.0]);
            let [b, d] = frame.velocity_in_board([0.0, 1.0]);
            a * d - b * c
        };
        assert_eq!(FRAMES.map(determinant), [-1.0, 1.0, -1.0]);
    }

    #[test]
    fn the_image_frame_follows_the_contract() {
        let size = BoardSize::default();
        // Home of the left player: (0.11, 0.16) in the image.
        assert_close(Frame::Image.position_in_board(size, [0.11, 0.16]), [0.0, -0.10]);
        assert_close(Frame::Image.position_in_board(size, [0.0, 0.0]), [-0.16, -0.21]);
        assert_close(Frame::Image.velocity_in_board([0.3, -0.2]), [-0.2, 0.3]);
    }

    #[test]
    fn the_mirrored_builder_agrees_with_its_own_formula() {
        let size = BoardSize::default();
        let image = [0.05, 0.20];
        let by_builder = [0.16 - image[1], image[0] - 0.21];
        assert_close(
            Frame::SimMirrored.position_in_board(size, by_builder),
            Frame::Image.position_in_board(size, image),
        );
    }

    #[test]
    fn impossible_boards_are_refused() {
        for (short, long) in [(0.0, 0.42), (0.32, f64::NAN), (-0.32, 0.42), (0.32, 11.0)] {
            assert!(BoardSize::new(short, long).is_err());
        }
        assert_eq!(BoardSize::new(0.32, 0.42), Ok(BoardSize::default()));
    }
}
