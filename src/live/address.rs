//! Address of the live view, as `--live` takes it.

use std::{fmt, str::FromStr};

/// Port of Foxglove's WebSocket protocol.
const USUAL_PORT: u16 = 8765;
/// Only this computer.
const LOOPBACK: &str = "127.0.0.1";

/// `foxglove`, `foxglove:PORT` or `foxglove:HOST:PORT`.
///
/// ```
/// use klasktron::live::LiveAddress;
/// let address: LiveAddress = "foxglove".parse().unwrap();
/// assert_eq!(address.to_string(), "foxglove:127.0.0.1:8765");
/// let network: LiveAddress = "foxglove:0.0.0.0:9000".parse().unwrap();
/// assert_eq!((network.host.as_str(), network.port), ("0.0.0.0", 9000));
/// assert!("rviz".parse::<LiveAddress>().is_err());
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveAddress {
    /// Host name or address of an interface; the loopback interface by default.
    pub host: String,
    /// Port; 8765 by default, 0 for any free port.
    pub port: u16,
}

/// Error: a text that is not the address of a live view.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{found}' is no live view; write foxglove, foxglove:PORT or foxglove:HOST:PORT with a port from 0 to 65535"
)]
pub struct LiveAddressError {
    /// Text given.
    pub found: String,
}

impl LiveAddress {
    pub(super) fn host_and_port(&self) -> String {
        match self.host.contains(':') {
            true => format!("[{}]:{}", self.host, self.port),
            false => format!("{}:{}", self.host, self.port),
        }
    }
}

impl FromStr for LiveAddress {
    type Err = LiveAddressError;

    fn from_str(text: &str) -> Result<Self, LiveAddressError> {
        let wrong = || LiveAddressError { found: text.to_owned() };
        let rest = text.strip_prefix("foxglove").ok_or_else(wrong)?;
        if rest.is_empty() {
            return Ok(Self { host: LOOPBACK.to_owned(), port: USUAL_PORT });
        }
        let rest = rest.strip_prefix(':').ok_or_else(wrong)?;
        let (host, port) = rest.rsplit_once(':').unwrap_or((LOOPBACK, rest));
        let host = host.strip_prefix('[').and_then(|own| own.strip_suffix(']')).unwrap_or(host);
        match port.parse() {
            Ok(port) if !host.is_empty() => Ok(Self { host: host.to_owned(), port }),
            _ => Err(wrong()),
        }
    }
}

impl fmt::Display for LiveAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "foxglove:{}", self.host_and_port())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_others_refused_with_the_forms() {
        for (text, host, port) in [
            ("foxglove", "127.0.0.1", 8765),
            ("foxglove:9000", "127.0.0.1", 9000),
            ("foxglove:localhost:1", "localhost", 1),
            ("foxglove:[::1]:8765", "::1", 8765),
        ] {
            let address: LiveAddress = text.parse().unwrap();
            assert_eq!((address.host.as_str(), address.port), (host, port), "{text}");
            assert_eq!(address.to_string().parse(), Ok(address));
        }
        for text in ["", "rerun", "foxglove:", "foxglove:70000", "foxglove::1", "foxglove9000"] {
            let error = text.parse::<LiveAddress>().unwrap_err().to_string();
            assert!(error.starts_with(&format!("'{text}' is no live view; write ")), "{error}");
        }
    }
}
