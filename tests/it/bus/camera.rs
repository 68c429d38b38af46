//! The camera socket over UDP and in the file system, and as part of a link.

use klasktron::link::{CameraSocket, CameraSpec, Event, Link, LiveLink, Replay, parse_detections};
use std::{net::UdpSocket, sync::Arc, time::Duration};

const TEXT: &[u8] = br#"{"capture_time_ns": 5, "ball": {"x": 0.01, "y": -0.02}}"#;
const PATIENCE: Duration = Duration::from_secs(5);

#[test]
fn camera_over_udp() {
    let socket = CameraSocket::bind(&"udp:127.0.0.1:0".parse().unwrap()).unwrap();
    let address = socket.udp_address().unwrap();
    assert_eq!(socket.receive(Duration::ZERO).unwrap(), None);
    let taken = CameraSocket::bind(&CameraSpec::Udp(address.to_string())).unwrap_err().to_string();
    assert_eq!(
        taken,
        format!(
            "camera udp:{address}: another program receives there; end it first, or use another \
             address here and in the camera program"
        )
    );
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    let long = vec![b' '; 60_000];
    sender.send_to(TEXT, address).unwrap();
    sender.send_to(&long, address).unwrap();
    let datagram = socket.receive(PATIENCE).unwrap().unwrap();
    assert_eq!(parse_detections(&datagram).unwrap().ball.unwrap().y, -0.02);
    assert_eq!(socket.receive(PATIENCE).unwrap().unwrap().len(), long.len());
}

#[cfg(unix)]
#[test]
fn camera_in_the_file_system() {
    use std::os::unix::net::UnixDatagram;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera");
    let spec = CameraSpec::Unix(path.clone());
    // A socket file that nobody listens on any more is replaced.
    drop(UnixDatagram::bind(&path).unwrap());
    assert!(path.exists());
    let socket = CameraSocket::bind(&spec).unwrap();
    let taken = CameraSocket::bind(&spec).unwrap_err().to_string();
    assert!(taken.contains(": another program receives there; end it first"), "{taken}");
    UnixDatagram::unbound().unwrap().send_to(TEXT, &path).unwrap();
    assert_eq!(socket.receive(PATIENCE).unwrap().unwrap(), TEXT);
    drop(socket);
    assert!(!path.exists(), "the file goes with its socket");

    std::fs::write(&path, "precious").unwrap();
    let refused = CameraSocket::bind(&spec).unwrap_err().to_string();
    assert!(refused.contains("there is a file of that name; use another path"), "{refused}");
    assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
}

/// The camera goes on when the bus has come to its end.
#[test]
fn camera_and_bus_make_one_stream() {
    let log = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(log.path(), "(1.0) can0 029#00\n").unwrap();
    let camera = CameraSocket::bind(&"udp:127.0.0.1:0".parse().unwrap()).unwrap();
    let address = camera.udp_address().unwrap();
    let transport = Arc::new(Replay::open(log.path(), None).unwrap());
    let mut link = LiveLink::start(transport, Some(Box::new(camera))).unwrap();
    let soon = link.now().after_seconds(PATIENCE.as_secs_f64());
    assert!(matches!(link.next_event(soon).unwrap(), Some(Event::Frame { .. })));
    assert_eq!(link.next_event(soon).unwrap(), Some(Event::End));
    UdpSocket::bind("127.0.0.1:0").unwrap().send_to(TEXT, address).unwrap();
    assert!(matches!(link.next_event(soon).unwrap(), Some(Event::Camera { .. })));
}
