//! Parts of addresses as users type them: hosts with ports, and serial ports with their settings.

use isotherm_profile::{Parity, Serial, host_and_port};

/// Default settings of a serial port. Most modules have these settings on delivery.
const SHIPPED_WITH: Serial = Serial { baud: 9600, parity: Parity::None, stop_bits: 1 };

/// Returns host and port of an address. If the address has no port, adds `usual`, the default port of this type of bus.
pub(super) fn host(text: &str, usual: Option<u16>) -> Result<String, String> {
    let text = text.strip_suffix('/').unwrap_or(text);
    if text.is_empty() {
        return Err("the host is missing; write tcp://192.168.0.10:502".to_owned());
    }
    match (host_and_port(text), usual) {
        (Ok((_, Some(port))), _) if port > 0 => Ok(text.to_owned()),
        (Ok((host, None)), Some(usual)) => Ok(format!("{host}:{usual}")),
        (Ok((host, None)), None) => {
            Err(format!("the port of {host} is missing; write rtu+tcp://{host}:4001"))
        }
        (place, _) => {
            let help = place.err().and_then(|why| why.help(usual.unwrap_or(4001), str::to_owned));
            let help = help.unwrap_or_else(|| "write 192.168.0.10:502".to_owned());
            Err(format!("`{text}` is not a host and port; {help}"))
        }
    }
}

/// Returns host and port of a server's URL.
pub(super) fn host_of_url(url: &str) -> &str {
    let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
    rest.split('/').next().unwrap_or_default()
}

/// Parses an address of a serial port: returns its settings and its path.
pub(super) fn serial(text: &str) -> Result<(Serial, String), String> {
    let (path, settings) = text.split_once('?').unwrap_or((text, ""));
    if !path.starts_with('/') {
        return Err(format!("`{path}` is not a serial port; write three slashes: rtu:///dev/ttyUSB0"));
    }
    let mut serial = SHIPPED_WITH;
    for setting in settings.split('&').filter(|setting| !setting.is_empty()) {
        let (key, value) = setting.split_once('=').unwrap_or((setting, ""));
        let wrong = || format!("`{setting}`: ");
        match key {
            "baud" => serial.baud = baud(value).map_err(|why| wrong() + &why)?,
            "parity" => serial.parity = value.parse().map_err(|why: String| wrong() + &why)?,
            "stop_bits" => {
                let bits = value.parse().ok().filter(|bits| (1..=2).contains(bits));
                serial.stop_bits = bits.ok_or_else(|| wrong() + "allowed: 1, 2")?;
            }
            _ => {
                return Err(format!(
                    "`{key}` is not a setting of a serial port; allowed: baud, parity, stop_bits"
                ));
            }
        }
    }
    Ok((serial, path.to_owned()))
}

/// Parses an address of a serial port with 7 or 8 data bits: settings, data bits, path. `data_bits` is the default.
/// `scheme` is the beginning of the address in messages.
pub(super) fn serial_with_data_bits(
    text: &str,
    scheme: &str,
    mut data_bits: u8,
) -> Result<(Serial, u8, String), String> {
    let (path, settings) = text.split_once('?').unwrap_or((text, ""));
    let mut others = Vec::new();
    for setting in settings.split('&') {
        match setting.strip_prefix("data_bits=") {
            None => others.push(setting),
            Some("7") => data_bits = 7,
            Some("8") => data_bits = 8,
            Some(_) => return Err(format!("`{setting}`: allowed: 7, 8")),
        }
    }
    let found = serial(&format!("{path}?{}", others.join("&")));
    let (serial, path) = found.map_err(|why| {
        why.replace("rtu://", scheme).replace("allowed: baud, parity", "allowed: baud, data_bits, parity")
    })?;
    Ok((serial, data_bits, path))
}

/// Returns the settings of a serial port as text lines of a profile.
pub(super) fn profile_lines(Serial { baud, parity, stop_bits }: Serial, data_bits: u8) -> String {
    let parity = parity.word();
    format!("baud = {baud}\ndata_bits = {data_bits}\nparity = \"{parity}\"\nstop_bits = {stop_bits}\n")
}

/// Parses the bits per second of a serial port.
///
/// # Errors
/// The allowed range, in one sentence.
pub fn baud(text: &str) -> Result<u32, String> {
    let baud = text.trim().parse().ok().filter(|baud| (300..=4_000_000).contains(baud));
    baud.ok_or_else(|| format!("`{text}` is not a valid number of bits per second; allowed: 300 to 4000000"))
}
