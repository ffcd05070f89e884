//! Kinds of files, and the messages for a file of the wrong kind.

use std::path::Path;

use crate::error::ProfileError;

/// Kind of a file, recognised by its content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// Profile of a machine.
    Profile,
    /// Device template.
    Template,
    /// Description of a plant (simulated machine).
    Plant,
    /// Model of an axis that `isotherm identify --write` wrote.
    ModelBlock,
    /// Script of faults for the virtual machine.
    FaultScript,
    /// Log: a table of numbers as text.
    Log,
    /// Parquet file, which is a log too.
    Parquet,
    /// DBC file, which describes CAN frames.
    Dbc,
    /// Electronic data sheet of a CANopen node (EDS or DCF).
    Eds,
    /// Data sheet of a CANopen node in XML (XDD).
    Xdd,
    /// KCD file, which describes CAN frames.
    Kcd,
    /// ARXML file of AUTOSAR.
    Arxml,
    /// SYM file, which describes CAN frames.
    Sym,
    /// FIBEX file, which describes frames.
    Fibex,
    /// LDF file, which describes a LIN bus.
    Ldf,
    /// A2L file, which describes the memory of a control unit.
    A2l,
    /// Mesh or input file of a finite element program.
    Mesh,
    /// JSON document.
    Json,
    /// YAML document.
    Yaml,
    /// Workbook of a spreadsheet program, or another ZIP archive.
    Workbook,
    /// Compressed file (gzip).
    Compressed,
    /// File compressed by another program (bzip2, xz, zstd or 7-Zip).
    Packed,
    /// Table of another program (Feather, HDF5 or MATLAB).
    OtherTable,
    /// Recording of a measuring program (MF4, BLF or TDMS).
    Measurement,
    /// PDF document.
    Pdf,
    /// Web page.
    Html,
    /// Other XML document.
    Xml,
}

/// Message for a file of the wrong kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Misplaced {
    /// Sentence that names the kind of the file and the expected kind.
    pub message: String,
    /// Hint: the use of this file, or how to get the expected file.
    pub help: String,
}

impl FileKind {
    /// Returns the message for a file of this kind if the kind `wanted` is expected. `None` if the file may be of the
    /// kind `wanted`.
    pub fn instead_of(self, wanted: FileKind) -> Option<Misplaced> {
        let serves = match wanted {
            // The reader of logs has its own messages about workbooks and compressed files.
            FileKind::Log => {
                matches!(self, FileKind::Log | FileKind::Parquet | FileKind::Workbook | FileKind::Compressed)
            }
            // The terms of a model are read from a profile too.
            FileKind::ModelBlock => matches!(self, FileKind::ModelBlock | FileKind::Profile),
            other => self == other,
        };
        (!serves).then(|| Misplaced {
            message: format!("this is {}, not {}", self.noun(), wanted.noun()),
            help: self.help(wanted).to_owned(),
        })
    }

    /// Returns a message if the file extension of a log belongs to another format. `None` if the extension is right, or
    /// if this kind is not a log.
    pub(super) fn of_another_ending(self, ending: &str) -> Option<&'static str> {
        let is_one_of = |known: &[&str]| known.iter().any(|known| ending.eq_ignore_ascii_case(known));
        let (known, message): (&[&str], &'static str) = match self {
            FileKind::Parquet => {
                (&["parquet"], "this is a Parquet file: rename it to a name that ends with .parquet")
            }
            FileKind::Compressed => (
                &["gz"],
                "this is a file compressed by gzip: rename a CSV log to a name that ends with .csv.gz",
            ),
            FileKind::Workbook => (
                &["xlsx", "xlsm", "xls", "xlsb", "ods"],
                "this is a workbook or an archive: rename a workbook to a name that ends with .xlsx, or \
                 extract the log from an archive",
            ),
            FileKind::Log if is_one_of(&["parquet", "gz", "xlsx", "xlsm", "xls", "xlsb", "ods"]) => {
                (&[], "this log is a text file: rename it to a name that ends with .csv")
            }
            _ => return None,
        };
        (!is_one_of(known)).then_some(message)
    }

    /// Returns the name of the kind with its article, for messages.
    fn noun(self) -> &'static str {
        match self {
            FileKind::Profile => "a profile",
            FileKind::Template => "a device template",
            FileKind::Plant => "the description of a plant",
            FileKind::ModelBlock => "a model block",
            FileKind::FaultScript => "a fault script",
            FileKind::Log => "a log",
            FileKind::Parquet => "a log in a Parquet file",
            FileKind::Dbc => "a DBC file",
            FileKind::Eds => "an EDS file",
            FileKind::Xdd => "an XDD file",
            FileKind::Kcd => "a KCD file",
            FileKind::Arxml => "an ARXML file",
            FileKind::Sym => "a SYM file",
            FileKind::Fibex => "a FIBEX file",
            FileKind::Ldf => "an LDF file",
            FileKind::A2l => "an A2L file",
            FileKind::Mesh => "the mesh or input file of a finite element program",
            FileKind::Json => "a JSON document",
            FileKind::Yaml => "a YAML document",
            FileKind::Workbook => "a workbook (.xlsx, .xls) or another archive",
            FileKind::Compressed => "a compressed file (gzip)",
            FileKind::Packed => "a compressed file (bzip2, xz, zstd or 7-Zip)",
            FileKind::OtherTable => "a table of another program (Feather, HDF5 or MATLAB)",
            FileKind::Measurement => "a recording of a measuring program (MF4, BLF or TDMS)",
            FileKind::Pdf => "a PDF document",
            FileKind::Html => "a web page",
            FileKind::Xml => "an XML document",
        }
    }

    /// Returns the use of a file of this kind, or how to get a file of the kind `wanted` from it.
    fn help(self, wanted: FileKind) -> &'static str {
        match (self, wanted) {
            (FileKind::Log | FileKind::Parquet, _) => {
                "give the profile of the machine first and the log after it, as `isotherm identify \
                 machine.toml day.csv`"
            }
            (FileKind::Profile, FileKind::Log) => {
                "give the profile first and the logs after it, as `isotherm identify machine.toml day.csv`"
            }
            (FileKind::Profile, FileKind::Template) => {
                "a template has `title` and `source`, and the channels of one device; give the profile on the \
                 command line, as `isotherm check machine.toml`"
            }
            (FileKind::Profile, _) => "use this file as the profile: `isotherm check machine.toml`",
            (FileKind::Template, _) => {
                "save this file as devices/NAME.toml next to the profile, and write template = \"NAME\" at a device of \
                 the profile"
            }
            (FileKind::Plant, _) => {
                "use the profile instead: `isotherm virtual machine.toml` also reads machine.plant.toml in \
                 the same directory"
            }
            (FileKind::ModelBlock, _) => {
                "replace the tables [[axis.….model]] of this axis in the profile of the machine with the text of this \
                 file"
            }
            (FileKind::FaultScript, _) => {
                "give this file to the virtual machine: `isotherm virtual machine.toml --faults faults.toml`"
            }
            (FileKind::Dbc, _) => {
                "write dbc = \"module.dbc\" with the name of this file at a device on a CAN line of the profile"
            }
            (FileKind::Eds | FileKind::Xdd, FileKind::Dbc) => {
                "this file describes the objects of a CANopen node, not frames: remove `dbc`, and write \
                 sdo = \"7130:01\" or pdo = { … } at each signal"
            }
            (FileKind::Eds | FileKind::Xdd, _) => {
                "this file describes a CANopen node: write sdo = \"7130:01\" or pdo = { … } at the signals \
                 of a profile"
            }
            (FileKind::Kcd | FileKind::Arxml | FileKind::Sym, FileKind::Dbc) => {
                "convert the file with cantools (`pip install cantools`): `cantools convert THIS_FILE module.dbc`"
            }
            (FileKind::Kcd | FileKind::Arxml | FileKind::Sym, _) => {
                "convert the file with `cantools convert THIS_FILE module.dbc`, and write dbc = \"module.dbc\" at a \
                 device of the profile"
            }
            (FileKind::Fibex, _) => {
                "convert the file with canmatrix (`pip install canmatrix`): `canconvert THIS_FILE module.dbc`"
            }
            (FileKind::Workbook | FileKind::Json, FileKind::Dbc) => {
                "if the file lists frames, convert it with canmatrix (`pip install canmatrix`): `canconvert THIS_FILE \
                 module.dbc`"
            }
            (FileKind::Ldf, _) => "isotherm cannot read a LIN bus; use a gateway from LIN to CAN or Modbus",
            (FileKind::A2l, _) => "export the frames as a DBC file with the program that wrote this file",
            (FileKind::Mesh, _) => "use this file with `isotherm place`",
            (FileKind::Json | FileKind::Yaml, FileKind::Log) => "save the log as CSV",
            (FileKind::Json, FileKind::Profile) => {
                "a profile is TOML: write [machine] and name = \"press-7\" instead of \"machine\": { \"name\": … }. \
                 `isotherm init` writes a profile. If this file is a model, write file = \"model.json\" in the profile"
            }
            (FileKind::Yaml, FileKind::Profile | FileKind::Template) => {
                "this file must be TOML: write [machine] and name = \"press-7\" instead of `machine:` and \
                 `name: press-7`"
            }
            (FileKind::Json, _) => {
                "if this file is a model, write file = \"model.json\" at this model in the profile"
            }
            (FileKind::Workbook, _) => "a workbook can only contain a log: save its sheet as CSV",
            (FileKind::Compressed, _) => "decompress it with `gunzip`",
            (FileKind::Packed, _) => "decompress it",
            (FileKind::OtherTable, _) => "export the table as CSV or Parquet",
            (FileKind::Measurement, _) => "export the recording as CSV",
            (FileKind::Html, _) => {
                "the web page was saved instead of the file: download the file itself, on GitHub with \"Raw\""
            }
            (FileKind::Pdf | FileKind::Xml | FileKind::Yaml, _) => "give another file",
        }
    }
}

impl Misplaced {
    /// Converts the message into an error about the file with the name `file`.
    pub(crate) fn error(self, file: impl Into<String>) -> ProfileError {
        ProfileError::about(file, self.message, Some(self.help))
    }

    /// Formats file name, message and hint as one line.
    #[must_use]
    pub fn line(&self, file: &Path) -> String {
        format!("{}: {}; {}", file.display(), self.message, self.help)
    }
}
