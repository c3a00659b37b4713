//! Address of `--metrics`.

use linkwatch::{Error, Result};
use std::fmt;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener};
use std::str::FromStr;

/// A host and a port. A port alone means the loopback interface of this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address(String);

impl Address {
    /// Listens on the address. If a name has several addresses, on the first one that works.
    ///
    /// # Errors
    ///
    /// [`Error::Usage`] if the address is in use, not permitted, or of another machine.
    pub fn listen(&self) -> Result<TcpListener> {
        TcpListener::bind(&self.0).map_err(|e| {
            let advice = match e.kind() {
                ErrorKind::AddrInUse => "; give another port, or port 0 for a free one",
                ErrorKind::AddrNotAvailable => "; give an address of this machine",
                ErrorKind::PermissionDenied => "; give a port from 1024 on",
                _ => "",
            };
            Error::Usage(format!("--metrics {self}: {e}{advice}"))
        })
    }
}

impl FromStr for Address {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Address, &'static str> {
        let (host, port) = text.rsplit_once(':').unwrap_or(("127.0.0.1", text));
        let address = format!("{host}:{port}");
        // Not `+80`.
        let is_port = port.parse::<u16>().is_ok() && port.bytes().all(|b| b.is_ascii_digit());
        // A name has a letter. The system would take "0" for 0.0.0.0: all interfaces.
        let is_name = host.contains(|c: char| c.is_alphabetic())
            && !host.contains(|c: char| c.is_whitespace() || ":[]/*".contains(c));
        match is_port && (is_name || address.parse::<SocketAddr>().is_ok()) {
            true => Ok(Address(address)),
            false => {
                Err("expected PORT or HOST:PORT, as in 9464, 192.0.2.1:9464 or [2001:db8::1]:9464")
            }
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_on_the_loopback_interface() {
        for (text, full) in [
            ("9464", "127.0.0.1:9464"),
            ("0", "127.0.0.1:0"),
            ("0.0.0.0:80", "0.0.0.0:80"),
            ("[::1]:65535", "[::1]:65535"),
            ("localhost:1", "localhost:1"),
        ] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), full);
        }
    }

    #[test]
    fn malformed_and_abbreviated_addresses_are_refused() {
        for text in [
            "",
            ":9464",
            "0:9464",
            "127.1:9464",
            "*:9464",
            "host",
            "host:",
            "host:65536",
            "+80",
            "host:+80",
            "::1:9464",
            "[::1]",
            "[host]:80",
            "::",
            "http://host:80",
            "a b:80",
            "-1",
        ] {
            assert!(text.parse::<Address>().is_err(), "{text:?}");
        }
    }
}
