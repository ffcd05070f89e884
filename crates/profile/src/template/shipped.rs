//! The templates that are part of the program.

macro_rules! shipped {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_str!(concat!("../../../../profiles/devices/", $name, ".toml")))),*]
    };
}

const SHIPPED: [(&str, &str); 32] = shipped![
    "advantech-adam-6018",
    "advantech-adam-60xx-counter",
    "aspar-sdm-8i8o",
    "atal-awp-c",
    "axiomatic-axtc4co",
    "comwintop-tc-logger",
    "css-canmod-temp",
    "ditel-dn-nb",
    "dm36b06",
    "excelog-6",
    "exemys-rme1-tc",
    "fanuc-modbus-server",
    "heidenhain-tnc-words",
    "icp-das-m7018",
    "icp-das-m7019r",
    "icp-das-m7084",
    "icp-das-tm-th8",
    "isma-sfar-s-6ti",
    "lika-em58",
    "linuxcnc-classicladder",
    "linuxcnc-eoffset",
    "moxa-iologik-e1200-counter",
    "moxa-iologik-e1262",
    "omega-iserver-2",
    "peak-mu-thermocouple1",
    "plc-block",
    "siko-ap10",
    "sinumerik-plc",
    "temposonics-e-canopen",
    "tr-la-46-k",
    "wago-750-462",
    "wago-750-469",
];

/// Their names.
pub fn names() -> impl Iterator<Item = &'static str> {
    SHIPPED.iter().map(|(name, _)| *name)
}

/// The text of one.
pub(super) fn text(name: &str) -> Option<&'static str> {
    SHIPPED.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// The DBC files that templates name.
const DBC: [(&str, &str); 1] =
    [("devices/css-canmod-temp.dbc", include_str!("../../../../profiles/devices/css-canmod-temp.dbc"))];

/// The text of a shipped DBC file, by the name that a template gives it.
pub(crate) fn dbc(name: &str) -> Option<&'static str> {
    DBC.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}
