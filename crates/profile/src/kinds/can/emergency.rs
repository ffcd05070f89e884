//! Meanings of CANopen emergency codes.

/// CANopen emergency code, or class of such codes, with its meaning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Emergency {
    /// Emergency code of CiA 301, or of the manufacturer.
    pub code: u16,
    /// Bits of the code that must match: 0xFFFF for one code, 0xFF00 for a class of codes.
    pub mask: u16,
    /// Meaning of the code.
    pub meaning: String,
}

/// Emergency codes of CiA 301: code, mask and meaning. The most specific entry that matches a code gives its meaning.
const GENERIC: [(u16, u16, &str); 34] = [
    (0x0000, 0xff00, "no error, or error gone"),
    (0x1000, 0xff00, "generic error"),
    (0x2000, 0xff00, "current"),
    (0x2100, 0xff00, "current, device input side"),
    (0x2200, 0xff00, "current inside the device"),
    (0x2300, 0xff00, "current, device output side"),
    (0x3000, 0xff00, "voltage"),
    (0x3100, 0xff00, "mains voltage"),
    (0x3200, 0xff00, "voltage inside the device"),
    (0x3300, 0xff00, "output voltage"),
    (0x4000, 0xff00, "temperature"),
    (0x4100, 0xff00, "ambient temperature"),
    (0x4200, 0xff00, "device temperature"),
    (0x5000, 0xff00, "device hardware"),
    (0x6000, 0xff00, "device software"),
    (0x6100, 0xff00, "internal software"),
    (0x6200, 0xff00, "user software"),
    (0x6300, 0xff00, "data set"),
    (0x7000, 0xff00, "additional modules"),
    (0x8000, 0xff00, "monitoring"),
    (0x8100, 0xff00, "communication"),
    (0x8110, 0xffff, "CAN overrun: frames lost"),
    (0x8120, 0xffff, "CAN in error passive mode"),
    (0x8130, 0xffff, "life guard error or heartbeat error"),
    (0x8140, 0xffff, "recovered from bus off"),
    (0x8150, 0xffff, "CAN identifier collision"),
    (0x8200, 0xff00, "protocol error"),
    (0x8210, 0xffff, "PDO not processed: length error"),
    (0x8220, 0xffff, "PDO longer than mapped"),
    (0x8240, 0xffff, "unexpected length of SYNC"),
    (0x8250, 0xffff, "RPDO did not arrive in time"),
    (0x9000, 0xff00, "external error"),
    (0xf000, 0xff00, "additional functions"),
    (0xff00, 0xff00, "device-specific error"),
];

impl Emergency {
    /// Returns whether this entry applies to a code: the bits of `mask` are equal.
    pub const fn names(&self, code: u16) -> bool {
        (self.code ^ code) & self.mask == 0
    }

    /// Returns the meaning of a code by CiA 301, for any device.
    pub fn generic(code: u16) -> &'static str {
        let fits = |(known, mask, _): &&(u16, u16, &str)| (known ^ code) & mask == 0;
        let class = |(known, ..): &&(u16, u16, &str)| known ^ (code & 0xf000) == 0;
        let exact = GENERIC.iter().rev().find(fits);
        exact
            .or_else(|| GENERIC.iter().find(class))
            .map_or("code that CiA 301 does not define", |known| known.2)
    }
}

#[cfg(test)]
mod tests {
    use super::super::node::CanDevice;
    use super::*;

    #[test]
    fn a_code_means_what_the_device_says_else_its_nearest_class() {
        for (code, meaning) in [
            (0x8130, "life guard error or heartbeat error"),
            (0x8199, "communication"),
            (0x8000, "monitoring"),
            (0x4233, "device temperature"),
            (0x4900, "temperature"),
            (0x0000, "no error, or error gone"),
            (0xff07, "device-specific error"),
            (0xb000, "code that CiA 301 does not define"),
        ] {
            assert_eq!(Emergency::generic(code), meaning, "{code:#06x}");
        }
        let own = |code, mask, meaning: &str| Emergency { code, mask, meaning: meaning.to_owned() };
        let device = CanDevice {
            node: Some(5),
            start: true,
            heartbeat: None,
            setup: Vec::new(),
            emergencies: vec![own(0x5030, 0xfff0, "sensor"), own(0x5031, 0xffff, "sensor 1 open")],
            written: Vec::new(),
        };
        assert_eq!(device.emergency(0x5031), "sensor 1 open");
        assert_eq!(device.emergency(0x5032), "sensor");
        assert_eq!(device.emergency(0x5000), "device hardware");
    }
}
