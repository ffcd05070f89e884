//! Engineering units of OPC UA: numbers that encode the codes of UN/CEFACT Recommendation 20.

use ::opcua::types::{EUInformation, LocalizedText, UAString};

const NAMESPACE: &str = "http://www.opcfoundation.org/UA/units/un/cefact";
/// Number for a unit that has no code in the recommendation.
const NO_CODE: i32 = -1;

/// Units of the status, each with its code and its symbol. If a unit has no code, the code is empty.
const UNITS: [(&str, &str, &str); 25] = [
    ("degC", "CEL", "°C"),
    ("K", "KEL", "K"),
    ("mm", "MMT", "mm"),
    ("um", "4H", "µm"),
    ("µm", "4H", "µm"),
    ("rpm", "RPM", "r/min"),
    ("percent", "P1", "%"),
    ("mm/min", "H81", "mm/min"),
    ("m/s", "MTS", "m/s"),
    ("l/min", "L2", "l/min"),
    ("bar", "BAR", "bar"),
    ("V", "VLT", "V"),
    ("mV", "2Z", "mV"),
    ("A", "AMP", "A"),
    ("mA", "4K", "mA"),
    ("W", "WTT", "W"),
    ("kW", "KWT", "kW"),
    ("N", "NEW", "N"),
    ("Nm", "NU", "N·m"),
    ("Hz", "HTZ", "Hz"),
    ("s", "SEC", "s"),
    ("ms", "C26", "ms"),
    ("µm/mm", "", "µm/mm"),
    ("µm/s", "", "µm/s"),
    ("count", "", "count"),
];

/// Returns the OPC UA engineering unit for the name of a unit in the status; `None` for a value without a unit.
pub(super) fn engineering_unit(unit: &str) -> Option<EUInformation> {
    let (_, code, symbol) = UNITS.iter().find(|(known, _, _)| *known == unit)?;
    Some(EUInformation {
        namespace_uri: UAString::from(NAMESPACE),
        unit_id: if code.is_empty() { NO_CODE } else { number(code) },
        display_name: LocalizedText::from(*symbol),
        description: LocalizedText::from(unit),
    })
}

/// Returns the number of a code, as OPC UA Part 8 defines it. The ASCII characters of the code are the bytes of the
/// number.
fn number(code: &str) -> i32 {
    code.bytes().fold(0, |number, byte| (number << 8) | i32::from(byte))
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_profile::Unit;

    #[test]
    fn the_numbers_are_those_of_the_published_table() {
        for (unit, number) in
            [("degC", 4_408_652), ("K", 4_932_940), ("mm", 5_066_068), ("um", 13_384), ("percent", 20_529)]
        {
            assert_eq!(engineering_unit(unit).unwrap().unit_id, number, "{unit}");
        }
        assert_eq!(engineering_unit("µm/mm").unwrap().unit_id, NO_CODE);
    }

    #[test]
    fn every_unit_of_a_signal_is_known_except_those_that_are_none() {
        for unit in Unit::WORDS {
            let is_none = matches!(unit, "bool" | "1");
            assert_eq!(engineering_unit(unit).is_none(), is_none, "{unit}");
        }
    }
}
