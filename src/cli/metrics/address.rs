//! Address of `--metrics`.

use linkwatch::{Error, Result};
use std::fmt;
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, TcpListener, ToSocketAddrs};
use std::str::FromStr;

/// A host and a port. A port alone means the loopback interface of this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    host: Host,
    port: u16,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Host {
    Ip(IpAddr),
    Name(String),
}

impl Address {
    /// Listens on the address. If a name has several addresses, on the first one that works.
    ///
    /// Errors: [`Error::Usage`] if the address is in use, not permitted, or of another machine.
    pub fn listen(&self) -> Result<TcpListener> {
        let bound = match &self.host {
            Host::Ip(ip) => TcpListener::bind((*ip, self.port)),
            Host::Name(name) => (name.as_str(), self.port)
                .to_socket_addrs()
                .and_then(|addresses| TcpListener::bind(&addresses.collect::<Vec<_>>()[..])),
        };
        bound.map_err(|e| {
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
        let host = if let Some(v6) = v6 {
            Host::Ip(v6.parse::<Ipv6Addr>().map_err(|_| MALFORMED)?.into())
        } else if host.bytes().all(|b| b.is_ascii_digit() || b == b'.') {
            // The system would take "0" for 0.0.0.0: all interfaces of the machine.
            Host::Ip(host.parse::<Ipv4Addr>().map_err(|_| MALFORMED)?.into())
        } else if host.contains([':', '[', ']', '/', '*']) || host.contains(char::is_whitespace) {
            return Err(MALFORMED);
        } else {
            Host::Name(host.to_owned())
        };
        Ok(Address { host, port })
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.host {
            Host::Ip(IpAddr::V6(ip)) => write!(f, "[{ip}]:{}", self.port),
            Host::Ip(IpAddr::V4(ip)) => write!(f, "{ip}:{}", self.port),
            Host::Name(name) => write!(f, "{name}:{}", self.port),
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
