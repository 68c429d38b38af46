//! The table: its size, and the coordinate frames used by other software.
//!
//! Everything inside klasktron is in the board frame: right-handed, z up, origin at the centre of
//! the playing field. `x` points across (short side), `y` from goal to goal; the left player owns y
//! < 0. Other software used other frames; [`Frame`] lists them and transforms them into the board
//! frame.
//!
//! ```
//! use klasktron::board::{BoardSize, Frame};
//! let size = BoardSize::default();
// The centre of the field in the ROS image frame is the board's origin.
//! let centre = Frame::Image.position_in_board(size, [0.21, 0.16]);
//! assert_eq!(centre, [0.0, 0.0]);
//! ```

mod frames;
mod pieces;

pub use frames::{BoardSize, BoardSizeError, Frame};
pub use pieces::{BALL_RADIUS, CUP_DISTANCE, CUP_RADIUS, STRIKER_RADIUS};
