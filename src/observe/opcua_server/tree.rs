//! Tree of the nodes: objects and variables with their names, made from the catalogue of the status fields and from the
//! names of the profile.
//!
//! The identifier of a node is made of names only: `axis.z.cz_um`, `signal.bed.value`. An identifier stays the same
//! after a restart, and after a change of the profile without renaming. The names of the folders and of the nameplates
//! are those of OPC 40001-1 (machinery) and OPC 40501-1 (machine tools).

use super::catalogue::{self, Field, Kind};
use crate::observe::status::Status;

/// Name and identifier of the root folder, which contains all nodes of the gateway.
const MACHINES: &str = "Machines";
/// Identifier of the object of the machine, which is the source of its events.
pub(super) const MACHINE: &str = "machine";
/// Identifier of the object of the gateway, which is a component of the machine.
const GATEWAY: &str = "gateway";
const IDENTIFICATION: &str = "Identification";
const COMPONENTS: &str = "Components";
const MONITORING: &str = "Monitoring";
const NOTIFICATION: &str = "Notification";

/// List of the status with a constant number of items. Each item becomes an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum List {
    Axes,
    Signals,
    Outputs,
    Devices,
}

/// List of the status with a varying number of items. Each field of the items becomes one array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Records {
    Alarms,
    Events,
}

/// Origin of the value that a variable node shows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// Property of a nameplate, which never changes.
    Nameplate(String),
    /// Field of the machine as a whole, outside the lists of the status.
    Machine(&'static str),
    /// Field of an item of a list. The values are the list, the index of the item, and the names that lead to the
    /// field.
    Item(List, usize, Vec<&'static str>),
    /// Field of all records of a list, as one array.
    Column(Records, &'static str),
    /// Number of records of a list.
    Total(Records),
}

/// Kind of an object node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// Folder, which only contains other nodes.
    Folder,
    /// Folder that OPC 40001-1 adds to a machine or to a component.
    AddIn,
    /// Object that only groups variables and other objects.
    Object,
    /// Object that is the source of events: the machine.
    EventSource,
}

/// Object node, which groups variables or other objects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Object {
    pub(super) id: String,
    /// Identifier of the parent object; `None` for the folder of all objects of the server.
    pub(super) parent: Option<String>,
    pub(super) name: String,
    /// Displayed name of the object.
    pub(super) label: String,
    pub(super) role: Role,
}

/// Variable node with one value of the status, or with a property of a nameplate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Variable {
    pub(super) id: String,
    pub(super) parent: String,
    pub(super) name: &'static str,
    /// Type of the value. It is never [`Kind::Object`].
    pub(super) kind: Kind,
    /// Unit, as in the status; empty if the value has no unit.
    pub(super) unit: String,
    pub(super) about: &'static str,
    pub(super) source: Source,
}

/// All nodes of a machine.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Tree {
    /// Objects of the machine. Each object comes after its parent object.
    pub(super) objects: Vec<Object>,
    pub(super) variables: Vec<Variable>,
    /// Names of the axes that accept measured errors.
    pub(super) probed: Vec<String>,
}

/// Returns the identifier of the object of an axis.
pub(super) fn axis_id(axis: &str) -> String {
    format!("axis.{axis}")
}

impl Tree {
    /// Makes the nodes of a machine from its status. Each [`List`] keeps its length and its order while the
    /// gateway runs.
    pub(super) fn of(status: &Status) -> Tree {
        let mut tree = Tree::default();
        tree.folder(None, MACHINES);
        let names = (status.machine.as_str(), status.label.as_str());
        tree.object(Some(MACHINES), MACHINE, names, Role::EventSource);
        for add_in in [IDENTIFICATION, COMPONENTS] {
            tree.object(Some(MACHINE), add_in, (add_in, ""), Role::AddIn);
        }
        for folder in [MONITORING, NOTIFICATION] {
            tree.folder(Some(MACHINE), folder);
        }
        tree.nameplates(status);
        for field in catalogue::fields(catalogue::MACHINE) {
            let id = format!("{MACHINE}.{}", field.name);
            tree.variable(id, MONITORING, field, String::new(), Source::Machine(field.name));
        }
        let axes = status.axes.iter().map(|axis| (axis.name.as_str(), axis.label.as_str(), ""));
        tree.items((COMPONENTS, "Axes", "axis"), (catalogue::AXES, List::Axes), axes);
        let outputs = status.outputs.iter().map(|output| (output.name.as_str(), "", output.unit()));
        tree.items((COMPONENTS, "Outputs", "output"), (catalogue::OUTPUTS, List::Outputs), outputs);
        let devices = status.devices.iter().map(|device| (device.name.as_str(), device.label.as_str(), ""));
        tree.items((COMPONENTS, "Devices", "device"), (catalogue::DEVICES, List::Devices), devices);
        let signals = status.signals.iter();
        let signals = signals.map(|signal| (signal.name.as_str(), signal.label.as_str(), signal.unit));
        tree.items((MONITORING, "Signals", "signal"), (catalogue::SIGNALS, List::Signals), signals);
        tree.records("Alarms", "alarms", catalogue::ALARMS, Records::Alarms);
        tree.records("Events", "events", catalogue::EVENTS, Records::Events);
        let probed = status.axes.iter().filter(|axis| axis.probe.is_some());
        tree.probed = probed.map(|axis| axis.name.clone()).collect();
        tree
    }

    fn folder(&mut self, parent: Option<&str>, name: &str) {
        self.object(parent, name, (name, ""), Role::Folder);
    }

    fn object(&mut self, parent: Option<&str>, id: &str, (name, label): (&str, &str), role: Role) {
        let label = if label.is_empty() { name } else { label };
        self.objects.push(Object {
            id: id.to_owned(),
            parent: parent.map(str::to_owned),
            name: name.to_owned(),
            label: label.to_owned(),
            role,
        });
    }

    fn variable(&mut self, id: String, parent: &str, field: Field, unit: String, source: Source) {
        if matches!(field.kind, Kind::Object(_)) {
            return;
        }
        let Field { name, kind, about, .. } = field;
        let unit = if field.unit.is_empty() { unit } else { field.unit.to_owned() };
        self.variables.push(Variable { id, parent: parent.to_owned(), name, kind, unit, about, source });
    }

    /// Adds two nameplates: one for the machine, and one for the gateway, which is a component of the machine. The
    /// nameplates have the form of OPC 40001-1.
    fn nameplates(&mut self, status: &Status) {
        let named = if status.label.is_empty() { &status.machine } else { &status.label };
        self.property((MACHINE, IDENTIFICATION), "ComponentName", named, "Displayed name of the machine.");
        self.object(Some(COMPONENTS), GATEWAY, ("Gateway", ""), Role::Object);
        let add_in = format!("{GATEWAY}.{IDENTIFICATION}");
        self.object(Some(GATEWAY), &add_in, (IDENTIFICATION, ""), Role::AddIn);
        let gateway = (GATEWAY, add_in.as_str());
        self.property(gateway, "Model", "isotherm", "Program that serves these nodes.");
        self.property(gateway, "SoftwareRevision", status.version, "Version of the program.");
    }

    /// Adds a property to the nameplate `add_in` of an object.
    fn property(
        &mut self,
        (object, add_in): (&str, &str),
        name: &'static str,
        text: &str,
        about: &'static str,
    ) {
        let field = Field { name, kind: Kind::Text, unit: "", about };
        let source = Source::Nameplate(text.to_owned());
        self.variable(format!("{object}.{name}"), add_in, field, String::new(), source);
    }

    /// Adds a folder with one object for each item of a list. Each item in `items` has a name, a label, and a
    /// unit. The identifier of an object is `word` and the name of its item, for example `axis.z`.
    fn items<'s>(
        &mut self,
        (parent, folder, word): (&str, &str, &str),
        (section, list): (&str, List),
        items: impl Iterator<Item = (&'s str, &'s str, &'s str)>,
    ) {
        self.folder(Some(parent), folder);
        let fields = catalogue::fields(section);
        let path: &[&'static str] = &[];
        for (place, (name, label, unit)) in items.enumerate() {
            let id = format!("{word}.{name}");
            self.object(Some(folder), &id, (name, label), Role::Object);
            self.fields(&id, &fields, unit, (list, place, path));
        }
    }

    /// Adds the fields of an item as variables, and the objects in the item.
    fn fields(
        &mut self,
        parent: &str,
        fields: &[Field],
        unit: &str,
        (list, place, path): (List, usize, &[&'static str]),
    ) {
        for field in fields {
            let id = format!("{parent}.{}", field.name);
            let path: Vec<&'static str> = path.iter().copied().chain([field.name]).collect();
            if let Kind::Object(section) = field.kind {
                self.object(Some(parent), &id, (field.name, ""), Role::Object);
                self.fields(&id, &catalogue::fields(section), unit, (list, place, path.as_slice()));
                continue;
            }
            let own = if has_unit_of_item(list, &path) { unit.to_owned() } else { String::new() };
            self.variable(id, parent, *field, own, Source::Item(list, place, path));
        }
    }

    /// Adds an object with one array for each field of the records, and with the number of records.
    fn records(&mut self, name: &str, id: &str, section: &str, records: Records) {
        self.object(Some(NOTIFICATION), id, (name, ""), Role::Object);
        let about = "Number of entries in each array.";
        let count = Field { name: "count", kind: Kind::Count, unit: "", about };
        self.variable(format!("{id}.count"), id, count, String::new(), Source::Total(records));
        for field in catalogue::fields(section).into_iter().filter(|field| field.kind == Kind::Text) {
            let column = Field { kind: Kind::Texts, ..field };
            let source = Source::Column(records, field.name);
            self.variable(format!("{id}.{}", field.name), id, column, String::new(), source);
        }
    }
}

/// Returns whether a field has the unit of its item: the value of a signal, and the values of an output.
fn has_unit_of_item(list: List, path: &[&str]) -> bool {
    matches!(
        (list, path),
        (List::Signals, ["value"]) | (List::Outputs, ["value" | "applied"] | ["shares", _])
    )
}

#[cfg(test)]
mod tests;
