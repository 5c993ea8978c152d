//! Parses the address of an MQTT broker, `mqtt://[USER[:PASSWORD]@]HOST[:PORT]` (`Broker`). Without
//! a port it is 1883; a user without password has that of `LOADTWIN_MQTT_PASSWORD`.

use std::str::FromStr;

/// Environment variable with the password, which other users of the computer do not see.
const PASSWORD: &str = "LOADTWIN_MQTT_PASSWORD";

/// Where messages go.
#[derive(Clone, PartialEq, Eq)]
pub struct Broker {
    /// Name or address.
    pub host: String,
    /// Port.
    pub port: u16,
    /// User and password.
    pub user: Option<(String, String)>,
}

// Without the password.
impl std::fmt::Debug for Broker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "mqtt://{}:{}", self.host, self.port)
    }
}

impl FromStr for Broker {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let allowed = || "allowed: mqtt://[USER[:PASSWORD]@]HOST[:PORT]".to_owned();
        if text.starts_with("mqtts://") {
            return Err(
                "TLS is not built in; allowed: mqtt:// to a broker of this network, which passes on over TLS \
                 (`bridge` of mosquitto)"
                    .to_owned(),
            );
        }
        let rest = text.strip_prefix("mqtt://").ok_or_else(allowed)?;
        let rest = rest.strip_suffix('/').unwrap_or(rest);
        let (user, place) = match rest.rsplit_once('@') {
            Some((user, place)) => (Some(user), place),
            None => (None, rest),
        };
        let is_port = |port: &str| !port.contains(']');
        let (host, port) = match place.rsplit_once(':').filter(|(_, port)| is_port(port)) {
            Some((host, port)) => (host, port.parse().map_err(|_| allowed())?),
            None => (place, 1883),
        };
        let host = host.trim_start_matches('[').trim_end_matches(']');
        if host.is_empty() || host.contains(['/', '?', '#', ' ']) || port == 0 {
            return Err(allowed());
        }
        let user = user.map(|user| match user.split_once(':') {
            Some((user, password)) => (user.to_owned(), password.to_owned()),
            None => (user.to_owned(), std::env::var(PASSWORD).unwrap_or_default()),
        });
        Ok(Self {
            host: host.to_owned(),
            port,
            user,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_brokers() {
        for (text, host, port, user) in [
            ("mqtt://broker", "broker", 1883, None),
            ("mqtt://10.0.0.1:1884/", "10.0.0.1", 1884, None),
            ("mqtt://[::1]:1884", "::1", 1884, None),
            (
                "mqtt://me:p@ss@broker",
                "broker",
                1883,
                Some(("me", "p@ss")),
            ),
        ] {
            let found: Broker = text.parse().unwrap();
            assert_eq!((found.host.as_str(), found.port), (host, port));
            assert_eq!(found.user, user.map(|(u, p)| (u.into(), p.into())));
        }
        for text in [
            "broker",
            "mqtt://",
            "mqtt://a:b",
            "http://broker",
            "mqtts://broker",
        ] {
            text.parse::<Broker>().unwrap_err();
        }
    }
}
