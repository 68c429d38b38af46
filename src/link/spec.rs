//! Bus address: the value of `--bus`, and the lock that keeps a second program off the bus.
//!
//! | text | bus |
//! |---|---|
//! | `socketcan:can0` | an interface of the Linux kernel |
//! | `slcan:/dev/ttyACM0` | a serial adapter, on any system |
//! | `socketcand:host:port` or `socketcand:host:port/can1` | gateway; `can0` by default |
//! | `replay:FILE` | log of `candump -L` |
//! | `virtual` | virtual table inside this program |

use super::{LinkError, Transport, slcan::Slcan, socketcand::Socketcand};
use std::{fmt, path::PathBuf, str::FromStr, sync::Arc};

/// Default interface of a gateway.
const DEFAULT_INTERFACE: &str = "can0";

/// Address of a table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum BusSpec {
    /// Virtual table inside this program.
    Virtual,
    /// Log.
    Replay(PathBuf),
    /// Live bus.
    Live(TransportSpec),
}

/// Live bus, on which motors may turn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TransportSpec {
    /// Interface of the Linux kernel.
    SocketCan {
        /// Name, such as `can0`.
        interface: String,
    },
    /// Serial adapter.
    Slcan {
        /// Device, such as `/dev/ttyACM0` or `COM3`.
        port: PathBuf,
    },
    /// Gateway in the network.
    Socketcand {
        /// Address `host:port`.
        server: String,
        /// Interface of the gateway.
        interface: String,
    },
}

/// Error: a text that is not a bus address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{found}' names no bus; write socketcan:INTERFACE, slcan:DEVICE, socketcand:HOST:PORT[/INTERFACE], \
     replay:FILE or virtual"
)]
pub struct BusSpecError {
    /// Text given.
    pub found: String,
}

impl FromStr for BusSpec {
    type Err = BusSpecError;

    fn from_str(text: &str) -> Result<Self, BusSpecError> {
        let wrong = || BusSpecError { found: text.to_owned() };
        if text == "virtual" {
            return Ok(Self::Virtual);
        }
        let (kind, rest) = text.split_once(':').ok_or_else(wrong)?;
        if rest.is_empty() {
            return Err(wrong());
        }
        let transport = match kind {
            "replay" => return Ok(Self::Replay(rest.into())),
            "socketcan" if !rest.contains(['/', ' ']) => {
                TransportSpec::SocketCan { interface: rest.to_owned() }
            }
            "slcan" => TransportSpec::Slcan { port: rest.into() },
            "socketcand" => parse_server(rest).ok_or_else(wrong)?,
            _ => return Err(wrong()),
        };
        Ok(Self::Live(transport))
    }
}

/// Parse `host:port` or `host:port/interface`; the host may be an IPv6 address in brackets.
fn parse_server(text: &str) -> Option<TransportSpec> {
    let (server, interface) = text.split_once('/').unwrap_or((text, DEFAULT_INTERFACE));
    let (host, port) = server.rsplit_once(':')?;
    let named = !interface.is_empty() && !interface.contains(['/', ' ', '<', '>']);
    if host.is_empty() || port.parse::<u16>().is_err() || !named {
        return None;
    }
    Some(TransportSpec::Socketcand { server: server.to_owned(), interface: interface.to_owned() })
}

impl fmt::Display for BusSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Virtual => f.write_str("virtual"),
            Self::Replay(path) => write!(f, "replay:{}", path.display()),
            Self::Live(transport) => transport.fmt(f),
        }
    }
}

impl fmt::Display for TransportSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SocketCan { interface } => write!(f, "socketcan:{interface}"),
            Self::Slcan { port } => write!(f, "slcan:{}", port.display()),
            Self::Socketcand { server, interface } => write!(f, "socketcand:{server}/{interface}"),
        }
    }
}

impl TransportSpec {
    /// Open the bus. `bitrate` (bit/s) is set on a serial adapter; a kernel interface or a gateway
    /// has a fixed bit rate.
    ///
    /// # Errors
    /// When the bus does not exist or cannot be used.
    pub fn open(&self, bitrate: u32) -> Result<Arc<dyn Transport>, LinkError> {
        log::info!("opening {self}");
        Ok(match self {
            Self::SocketCan { interface } => open_socketcan(interface)?,
            Self::Slcan { port } => Arc::new(Slcan::open(port, bitrate)?),
            Self::Socketcand { server, interface } => {
                Arc::new(Socketcand::open(server, interface)?)
            }
        })
    }

    /// Lock the bus for this program.
    ///
    /// # Errors
    /// When another program of this machine has locked it.
    pub fn lock(&self) -> Result<BusLock, LinkError> {
        BusLock::take(self)
    }

    /// Return one name per bus, independent of its spelling.
    #[cfg(target_os = "linux")]
    fn canonical_name(&self) -> String {
        match self {
            Self::Slcan { port } => {
                let port = port.canonicalize().unwrap_or_else(|_not_there_yet| port.clone());
                format!("slcan:{}", port.display())
            }
            Self::SocketCan { .. } | Self::Socketcand { .. } => self.to_string(),
        }
    }
}

#[cfg(target_os = "linux")]
fn open_socketcan(interface: &str) -> Result<Arc<dyn Transport>, LinkError> {
    Ok(Arc::new(super::socketcan::SocketCan::open(interface, &[])?))
}

#[cfg(not(target_os = "linux"))]
fn open_socketcan(interface: &str) -> Result<Arc<dyn Transport>, LinkError> {
    Err(LinkError::Unusable {
        bus: format!("socketcan:{interface}"),
        what: "only Linux has CAN interfaces".to_owned(),
        remedy: "use slcan:DEVICE or socketcand:HOST:PORT as --bus",
    })
}

/// Lock that keeps other collectors of this machine off a bus for its lifetime. Two programs that
/// both send setpoints would make motors jump between them.
///
/// On Linux it is a socket with an abstract name, which the kernel frees at the end of the program.
/// Other systems have no such names, and the lock has no effect there.
#[derive(Debug)]
pub struct BusLock {
    #[cfg(target_os = "linux")]
    _held: std::os::unix::net::UnixDatagram,
}

#[cfg(target_os = "linux")]
impl BusLock {
    /// Longest name that is used unchanged; the kernel takes 107 bytes.
    const LONGEST_NAME: usize = 80;

    fn take(spec: &TransportSpec) -> Result<Self, LinkError> {
        use std::os::{
            linux::net::SocketAddrExt,
            unix::net::{SocketAddr, UnixDatagram},
        };
        let mut name = spec.canonical_name();
        if Self::LONGEST_NAME < name.len() {
            name = format!("{:08x}", crc32fast::hash(name.as_bytes()));
        }
        SocketAddr::from_abstract_name(format!("klasktron/{name}"))
            .and_then(|address| UnixDatagram::bind_addr(&address))
            .map(|held| Self { _held: held })
            .map_err(|error| match error.kind() {
                std::io::ErrorKind::AddrInUse => LinkError::Unusable {
                    bus: spec.to_string(),
                    what: "another klasktron is driving this bus".to_owned(),
                    remedy: "end it first, or use another bus",
                },
                _ => LinkError::Unusable {
                    bus: spec.to_string(),
                    what: format!("the bus cannot be locked ({error})"),
                    remedy: "make sure that no other program drives this bus, and try again",
                },
            })
    }
}

#[cfg(not(target_os = "linux"))]
impl BusLock {
    fn take(_spec: &TransportSpec) -> Result<Self, LinkError> {
        Ok(Self {})
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn every_form_is_read_and_written_back() {
        for text in [
            "virtual",
            "replay:/logs/run 1.log",
            "socketcan:can0",
            "slcan:/dev/serial/by-id/usb-x",
            "slcan:COM3",
            "socketcand:table.local:29536/can1",
            "socketcand:[::1]:29536/can0",
        ] {
            assert_eq!(text.parse::<BusSpec>().unwrap().to_string(), text);
        }
        let short: BusSpec = "socketcand:10.0.0.2:29536".parse().unwrap();
        assert_eq!(short.to_string(), "socketcand:10.0.0.2:29536/can0");
    }

    #[test]
    fn other_texts_are_refused_with_the_forms() {
        for text in [
            "",
            "can0",
            "socketcan:",
            "socketcan:can0/1",
            "serial:/dev/ttyACM0",
            "socketcand:host",
            "socketcand::29536",
            "socketcand:host:99999",
            "socketcand:host:1/",
        ] {
            assert!(text.parse::<BusSpec>().is_err(), "{text}");
        }
        assert_eq!(
            "can0".parse::<BusSpec>().unwrap_err().to_string(),
            "'can0' names no bus; write socketcan:INTERFACE, slcan:DEVICE, \
             socketcand:HOST:PORT[/INTERFACE], replay:FILE or virtual"
        );
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_bus_is_taken_once_and_given_back() {
        let spec = |text: &str| match text.parse().unwrap() {
            BusSpec::Live(transport) => transport,
            other => panic!("{other}"),
        };
        let bus = spec(&format!("socketcan:test{}", std::process::id()));
        let held = bus.lock().unwrap();
        let refused = bus.lock().unwrap_err().to_string();
        assert!(refused.ends_with(
            ": another klasktron is driving this bus; end it first, or use another bus"
        ));
        drop(held);
        bus.lock().unwrap();
        let long = spec(&format!("slcan:/dev/{}", "x".repeat(200)));
        let _held = long.lock().unwrap();
        long.lock().unwrap_err();
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        #[test]
        fn what_is_read_is_written_back(text in "(socketcan|slcan|socketcand|replay|virtual)?:?[a-z0-9:/.]{0,20}") {
            if let Ok(spec) = text.parse::<BusSpec>() {
                prop_assert_eq!(spec.to_string().parse::<BusSpec>().unwrap(), spec);
            }
        }
    }
}
