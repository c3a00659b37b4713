//! Address of `--metrics`.

use linkwatch::{Error, Result};
use std::fmt;
use std::io::ErrorKind;
use std::net::{Ipv4Addr, Ipv6Addr, TcpListener};
use std::str::FromStr;

/// A host and a port. A port alone means the loopback interface of this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// A name, or an address of either kind, without brackets.
    host: String,
    port: u16,
}

impl Address {
    /// Listens on the address. If a name has several addresses, on the first one that works.
    ///
    /// Errors: [`Error::Usage`] if the address is in use, not permitted, or of another machine.
    pub fn listen(&self) -> Result<TcpListener> {
        TcpListener::bind((self.host.as_str(), self.port)).map_err(|e| {
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
        const MALFORMED: &str = "expected PORT or HOST:PORT, as in 9464, 192.0.2.1:9464 or \
                                 [2001:db8::1]:9464";
        let (host, port) = text.rsplit_once(':').unwrap_or(("127.0.0.1", text));
        let digits = port.bytes().all(|b| b.is_ascii_digit());
        let port = port.parse().ok().filter(|_| digits).ok_or(MALFORMED)?;
        let v6 = host.strip_prefix('[').and_then(|h| h.strip_suffix(']'));
        let valid = if let Some(v6) = v6 {
            v6.parse::<Ipv6Addr>().is_ok()
        } else if host.bytes().all(|b| b.is_ascii_digit() || b == b'.') {
            // The system would take "0" for 0.0.0.0: all interfaces of the machine.
            host.parse::<Ipv4Addr>().is_ok()
        } else {
            !host.contains(|c: char| c.is_whitespace() || ":[]/*".contains(c))
        };
        let host = v6.unwrap_or(host).to_owned();
        valid.then_some(Address { host, port }).ok_or(MALFORMED)
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.host.contains(':') {
            true => write!(f, "[{}]:{}", self.host, self.port),
            false => write!(f, "{}:{}", self.host, self.port),
        }
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
