//! Camera socket: the interface of a vision program. **This page is the definition of that
//! interface.**
//!
//! # Transport
//!
//! One datagram per camera frame, to an address that klasktron binds:
//!
//! - `udp:HOST:PORT`, for example `udp:127.0.0.1:5600`; `udp:0.0.0.0:5600` for a camera elsewhere in
//!   the network;
//! - `unix:PATH`, a datagram socket in the file system, for example `unix:/tmp/klasktron-camera`.
//!
//! Datagrams are not acknowledged. A datagram that is lost, late or wrong costs one camera frame.
//!
//! # Content
//!
//! One JSON object in UTF-8:
//!
//! ```json
//! {"capture_time_ns": 1700000000000000000,
//!  "ball": {"x": 0.012, "y": -0.101}, "left": {"x": -0.1, "y": 0.0}, "right": null}
//! ```
//!
//! | key | type | meaning |
//! |---|---|---|
//! | `capture_time_ns` | integer, 0 to 2^64 - 1, required | middle of the exposure (ns since the Unix epoch) |
//! | `ball`, `left`, `right` | object or `null`; absent means `null` | positions of the ball and
//! the two pegs; `null` when not detected |
//! | `x`, `y` of these | number, required | position in the board frame of [`crate::board`] (m), at
//! most 1 m from its centre |
//!
//! An object may carry the covariance of its position as `xx`, `xy` and `yy` (m^2), all three or none. Other keys are
//! ignored, so that a program may send additional values.

mod sender;

pub use sender::CameraSender;

use super::LinkError;
use crate::recording::message::{CameraDetections, Covariance, Point};
use serde_json::{Map, Value};
use std::{
    fmt,
    io::{self, ErrorKind},
    net::UdpSocket,
    path::PathBuf,
    str::FromStr,
    time::Duration,
};

/// Largest absolute coordinate on a table (m).
const FARTHEST_METRES: f64 = 1.0;
/// Largest size of a datagram.
const MAX_DATAGRAM_BYTES: usize = 65_536;
/// Shortest time-out; a time-out of 0 would wait forever.
const SHORTEST_TIMEOUT: Duration = Duration::from_millis(1);

/// Address of the camera socket.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CameraSpec {
    /// `HOST:PORT`.
    Udp(String),
    /// Socket in the file system.
    Unix(PathBuf),
}

/// Error: a text that is not a camera address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("'{found}' names no camera socket; write udp:HOST:PORT or unix:PATH")]
pub struct CameraSpecError {
    /// Text given.
    pub found: String,
}

impl FromStr for CameraSpec {
    type Err = CameraSpecError;

    fn from_str(text: &str) -> Result<Self, CameraSpecError> {
        match text.split_once(':') {
            Some(("udp", address))
                if address.rsplit_once(':').is_some_and(|(host, port)| {
                    !host.is_empty() && port.parse::<u16>().is_ok()
                }) =>
            {
                Ok(Self::Udp(address.to_owned()))
            }
            Some(("unix", path)) if !path.is_empty() => Ok(Self::Unix(path.into())),
            _ => Err(CameraSpecError { found: text.to_owned() }),
        }
    }
}

impl fmt::Display for CameraSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp(address) => write!(f, "udp:{address}"),
            Self::Unix(path) => write!(f, "unix:{}", path.display()),
        }
    }
}

/// Error of a datagram.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CameraError {
    /// Invalid JSON.
    #[error("the camera's datagram is no JSON ({reason}); send one object in UTF-8")]
    Json {
        /// Message of the parser.
        reason: String,
    },
    /// Field missing or of the wrong type.
    #[error("the camera's {field} is {found}; send {expected}")]
    Field {
        /// Name of the field.
        field: String,
        /// Value found.
        found: String,
        /// Expected value.
        expected: &'static str,
    },
    /// Coordinate outside any table.
    #[error("the camera's {field} is {found} m; send metres in the board frame, from -1 to 1")]
    Coordinate {
        /// Name of the field.
        field: String,
        /// Value found.
        found: String,
    },
}

/// Parse one datagram.
///
/// ```
/// let text = br#"{"capture_time_ns": 7, "ball": {"x": 0.1, "y": -0.05}}"#;
/// let seen = klasktron::link::parse_detections(text).unwrap();
/// assert_eq!(seen.ball.unwrap().y, -0.05);
/// assert_eq!(seen.left, None);
///
/// let far = br#"{"capture_time_ns": 7, "ball": {"x": 101.0, "y": 0}}"#;
/// assert_eq!(
///     klasktron::link::parse_detections(far).unwrap_err().to_string(),
///     "the camera's ball.x is 101.0 m; send metres in the board frame, from -1 to 1"
/// );
/// ```
///
/// # Errors
/// When the datagram does not follow the definition on this page.
pub fn parse_detections(datagram: &[u8]) -> Result<CameraDetections, CameraError> {
    let value: Value = serde_json::from_slice(datagram)
        .map_err(|error| CameraError::Json { reason: error.to_string() })?;
    let object = value.as_object().ok_or_else(|| wrong("datagram", Some(&value), "an object"))?;
    let time = object.get("capture_time_ns");
    let capture_time_ns = time
        .and_then(Value::as_u64)
        .ok_or_else(|| wrong("capture_time_ns", time, "nanoseconds as an integer"))?;
    Ok(CameraDetections {
        capture_time_ns,
        ball: parse_point(object, "ball")?,
        left: parse_point(object, "left")?,
        right: parse_point(object, "right")?,
        ball_covariance: parse_covariance(object, "ball")?,
        left_covariance: parse_covariance(object, "left")?,
        right_covariance: parse_covariance(object, "right")?,
    })
}

/// Covariance of an object; `None` without one.
fn parse_covariance(
    object: &Map<String, Value>,
    name: &str,
) -> Result<Option<Covariance>, CameraError> {
    let Some(point) = object.get(name).and_then(Value::as_object) else { return Ok(None) };
    let values = ["xx", "xy", "yy"].map(|key| point.get(key));
    if values.iter().all(Option::is_none) {
        return Ok(None);
    }
    let numbers = values.map(|value| value.and_then(Value::as_f64));
    match numbers {
        [Some(xx), Some(xy), Some(yy)] if 0.0 < xx && 0.0 < yy && xy * xy < xx * yy => {
            Ok(Some(Covariance { xx, xy, yy }))
        }
        _ => Err(wrong(
            &format!("{name}'s covariance"),
            object.get(name),
            "xx, xy and yy in m^2 of a positive definite matrix, or none of them",
        )),
    }
}

fn parse_point(object: &Map<String, Value>, name: &str) -> Result<Option<Point>, CameraError> {
    match object.get(name) {
        None | Some(Value::Null) => Ok(None),
        Some(Value::Object(point)) => Ok(Some(Point {
            x: parse_coordinate(point, name, "x")?,
            y: parse_coordinate(point, name, "y")?,
        })),
        other => Err(wrong(name, other, "an object with x and y, or null")),
    }
}

fn parse_coordinate(
    point: &Map<String, Value>,
    name: &str,
    axis: &str,
) -> Result<f64, CameraError> {
    let field = format!("{name}.{axis}");
    let value = point.get(axis);
    let metres =
        value.and_then(Value::as_f64).ok_or_else(|| wrong(&field, value, "a number of metres"))?;
    if metres.is_finite() && metres.abs() <= FARTHEST_METRES {
        Ok(metres)
    } else {
        Err(CameraError::Coordinate { field, found: shown(value) })
    }
}

fn wrong(field: &str, found: Option<&Value>, expected: &'static str) -> CameraError {
    CameraError::Field { field: field.to_owned(), found: shown(found), expected }
}

/// Return a value for a message, shortened.
fn shown(value: Option<&Value>) -> String {
    const LONGEST: usize = 40;
    let text = value.map_or_else(|| "missing".to_owned(), Value::to_string);
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

/// Source of datagrams with detections: a socket, or a camera with a detector in this program.
pub trait CameraFeed: Send {
    /// Return the next datagram within about `timeout`; `None` when none came.
    ///
    /// # Errors
    /// When the source is broken permanently.
    fn receive(&mut self, timeout: Duration) -> Result<Option<Vec<u8>>, LinkError>;
}

impl CameraFeed for CameraSocket {
    fn receive(&mut self, timeout: Duration) -> Result<Option<Vec<u8>>, LinkError> {
        Self::receive(self, timeout)
    }
}

/// Bound camera socket.
#[derive(Debug)]
pub struct CameraSocket {
    name: String,
    socket: Bound,
}

#[derive(Debug)]
enum Bound {
    Udp(UdpSocket),
    #[cfg(unix)]
    Unix {
        socket: std::os::unix::net::UnixDatagram,
        path: PathBuf,
    },
}

impl CameraSocket {
    /// Bind the socket. A stale socket file is replaced.
    ///
    /// # Errors
    /// When the address is in use or cannot be bound.
    pub fn bind(spec: &CameraSpec) -> Result<Self, LinkError> {
        let bound = match spec {
            CameraSpec::Udp(address) => UdpSocket::bind(address).map(Bound::Udp),
            CameraSpec::Unix(path) => bind_unix(path),
        };
        let name = format!("camera {spec}");
        match bound {
            Ok(socket) => Ok(Self { name, socket }),
            Err(error) => Err(bind_error(name, &error)),
        }
    }

    /// Return the address of a UDP socket, with the port that the system chose for port 0.
    #[must_use]
    pub fn udp_address(&self) -> Option<std::net::SocketAddr> {
        match &self.socket {
            Bound::Udp(socket) => socket.local_addr().ok(),
            #[cfg(unix)]
            Bound::Unix { .. } => None,
        }
    }

    /// Return the next datagram within `timeout`.
    ///
    /// # Errors
    /// When the socket is broken permanently.
    pub fn receive(&self, timeout: Duration) -> Result<Option<Vec<u8>>, LinkError> {
        let timeout = Some(timeout.max(SHORTEST_TIMEOUT));
        let mut bytes = [0; MAX_DATAGRAM_BYTES];
        let read = match &self.socket {
            Bound::Udp(socket) => {
                socket.set_read_timeout(timeout).and_then(|()| socket.recv(&mut bytes))
            }
            #[cfg(unix)]
            Bound::Unix { socket, .. } => {
                socket.set_read_timeout(timeout).and_then(|()| socket.recv(&mut bytes))
            }
        };
        match read {
            Ok(length) => Ok(Some(bytes[..length].to_vec())),
            Err(error) if is_pause(&error) => Ok(None),
            Err(error) => Err(LinkError::Unusable {
                bus: self.name.clone(),
                what: format!("receiving failed ({error})"),
                remedy: "start anew",
            }),
        }
    }
}

/// Return whether an error is temporary. Some systems report refused answers on UDP sockets.
fn is_pause(error: &io::Error) -> bool {
    use ErrorKind::{ConnectionRefused, ConnectionReset, Interrupted, TimedOut, WouldBlock};
    matches!(
        error.kind(),
        WouldBlock | TimedOut | Interrupted | ConnectionReset | ConnectionRefused
    )
}

impl Drop for CameraSocket {
    fn drop(&mut self) {
        #[cfg(unix)]
        if let Bound::Unix { path, .. } = &self.socket {
            // A stale file would be replaced at the next start.
            std::fs::remove_file(path).ok();
        }
    }
}

#[cfg(unix)]
fn bind_unix(path: &std::path::Path) -> io::Result<Bound> {
    use std::os::unix::{fs::FileTypeExt, net::UnixDatagram};
    if let Ok(there) = std::fs::symlink_metadata(path) {
        let refused = || {
            let probe = UnixDatagram::unbound()?;
            io::Result::Ok(
                probe.connect(path).is_err_and(|e| e.kind() == ErrorKind::ConnectionRefused),
            )
        };
        if !there.file_type().is_socket() {
            return Err(ErrorKind::AlreadyExists.into());
        }
        if !refused()? {
            return Err(ErrorKind::AddrInUse.into());
        }
        std::fs::remove_file(path)?;
    }
    let socket = UnixDatagram::bind(path)?;
    Ok(Bound::Unix { socket, path: path.to_owned() })
}

#[cfg(not(unix))]
fn bind_unix(_path: &std::path::Path) -> io::Result<Bound> {
    Err(ErrorKind::Unsupported.into())
}

fn bind_error(bus: String, error: &io::Error) -> LinkError {
    let (what, remedy) = match error.kind() {
        ErrorKind::AddrInUse => (
            "another program receives there".to_owned(),
            "end it first, or use another address here and in the camera program",
        ),
        ErrorKind::AlreadyExists => {
            ("there is a file of that name".to_owned(), "use another path; nothing was deleted")
        }
        ErrorKind::Unsupported => (
            "this system has no such sockets".to_owned(),
            "use udp:127.0.0.1:5600 here and in the camera program",
        ),
        _ => (
            format!("the address cannot be bound ({error})"),
            "give an address of this machine, such as udp:127.0.0.1:5600",
        ),
    };
    LinkError::Unusable { bus, what, remedy }
}

#[cfg(test)]
mod tests;
