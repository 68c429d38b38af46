//! Sending end of the camera socket.

use super::CameraSpec;
use crate::link::LinkError;
use std::{io, net::UdpSocket};

/// Sender of datagrams to the address of a collector.
#[derive(Debug)]
pub struct CameraSender {
    target: Target,
}

#[derive(Debug)]
enum Target {
    Udp(UdpSocket, String),
    #[cfg(unix)]
    Unix(std::os::unix::net::UnixDatagram, std::path::PathBuf),
}

impl CameraSender {
    /// Create a sender to `spec`; the receiver may start later.
    ///
    /// # Errors
    /// When the system cannot create a socket.
    pub fn connect(spec: &CameraSpec) -> Result<Self, LinkError> {
        Self::open(spec).map(|target| Self { target }).map_err(|error| LinkError::Unusable {
            bus: spec.to_string(),
            what: error.to_string(),
            remedy: "write udp:HOST:PORT or unix:PATH of the collector",
        })
    }

    fn open(spec: &CameraSpec) -> io::Result<Target> {
        match spec {
            CameraSpec::Udp(address) => {
                Ok(Target::Udp(UdpSocket::bind("0.0.0.0:0")?, address.clone()))
            }
            #[cfg(unix)]
            CameraSpec::Unix(path) => {
                Ok(Target::Unix(std::os::unix::net::UnixDatagram::unbound()?, path.clone()))
            }
            #[cfg(not(unix))]
            CameraSpec::Unix(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }

    /// Send one datagram; it is lost without a receiver, as any datagram may be.
    pub fn send(&self, datagram: &[u8]) {
        match &self.target {
            Target::Udp(socket, address) => socket.send_to(datagram, address).ok(),
            #[cfg(unix)]
            Target::Unix(socket, path) => socket.send_to(datagram, path).ok(),
        };
    }
}
