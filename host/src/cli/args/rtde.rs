//! The arguments of `screed rtde`.

use super::seconds;
use std::path::PathBuf;
use std::time::Duration;

/// The port of RTDE on a controller.
const PORT: u16 = 30_004;

/// `screed rtde`
#[derive(Clone, Debug, PartialEq, clap::Subcommand)]
pub enum RtdeCommand {
    /// Write a recipe's outputs as CSV, one row a package; nothing is written to the controller
    Record(RtdeRecordArgs),
}

/// `screed rtde record`
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct RtdeRecordArgs {
    /// The controller; without a port, 30004
    #[arg(long, value_name = "HOST[:PORT]", value_parser = address)]
    pub address: (String, u16),
    /// The recipes, XML as UR's own clients read it
    #[arg(long, value_name = "FILE.xml")]
    pub config: PathBuf,
    /// Which of them, by its key
    #[arg(long, value_name = "KEY", default_value = "out")]
    pub recipe: String,
    /// Packages a second; a controller with protocol 1 sends at its own rate
    #[arg(long, value_name = "HZ", default_value_t = 125, value_parser = clap::value_parser!(u32).range(1..=500))]
    pub rate: u32,
    /// End after so long, by the controller's time; without it, with Ctrl-C
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    pub seconds: Option<Duration>,
    /// Write to this file, instead of the standard output
    #[arg(short, long, value_name = "FILE.csv")]
    pub out: Option<PathBuf>,
    /// Overwrite that file where it is there already
    #[arg(long, requires = "out")]
    pub force: bool,
}

/// A host with or without a port; an IPv6 address with a port stands in brackets.
fn address(text: &str) -> Result<(String, u16), String> {
    let expected = || "expected HOST or HOST:PORT, an IPv6 address in brackets where a port follows".to_owned();
    let bare = |host: &str| host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host).to_owned();
    let is_bare_v6 = text.parse::<std::net::Ipv6Addr>().is_ok();
    let (host, port) =
        match text.rsplit_once(':').filter(|(host, _)| !is_bare_v6 && (!host.contains(':') || host.ends_with(']'))) {
            Some((host, port)) => (bare(host), port.parse().map_err(|_| expected())?),
            None => (bare(text), PORT),
        };
    let is_plain = !host.is_empty() && !host.contains(|c: char| c.is_whitespace() || c == '/' || c == '[' || c == ']');
    let is_v6 = host.parse::<std::net::Ipv6Addr>().is_ok();
    if is_plain && (is_v6 || !host.contains(':')) { Ok((host, port)) } else { Err(expected()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_a_port_or_the_usual_one() {
        let good = [
            ("10.0.0.2", ("10.0.0.2", 30_004)),
            ("robot.local:50", ("robot.local", 50)),
            ("::1", ("::1", 30_004)),
            ("[::1]", ("::1", 30_004)),
            ("[fe80::2]:7", ("fe80::2", 7)),
        ];
        for (text, (host, port)) in good {
            assert_eq!(address(text), Ok((host.to_owned(), port)), "{text}");
        }
        for text in ["", ":30004", "a:", "a:b", "a:70000", "a b", "http://a", "[::1", "a:1:2"] {
            assert!(address(text).is_err(), "{text}");
        }
    }
}
