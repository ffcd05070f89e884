use std::collections::BTreeSet;

use super::super::example::status;
use super::*;

fn variable<'t>(tree: &'t Tree, id: &str) -> &'t Variable {
    let found = tree.variables.iter().find(|variable| variable.id == id);
    found.unwrap_or_else(|| panic!("there is no {id}"))
}

#[test]
fn every_node_has_a_name_of_its_own_and_a_parent_before_it() {
    let tree = Tree::of(&status());
    let mut known = BTreeSet::new();
    for object in &tree.objects {
        assert!(object.parent.as_ref().is_none_or(|parent| known.contains(parent)), "{object:?}");
        assert!(known.insert(object.id.clone()), "{object:?}");
    }
    for variable in &tree.variables {
        assert!(known.contains(&variable.parent), "{variable:?}");
        assert!(!matches!(variable.kind, Kind::Object(_)), "{variable:?}");
    }
    for variable in &tree.variables {
        assert!(known.insert(variable.id.clone()), "{variable:?}");
    }
}

#[test]
fn the_nodes_of_axes_signals_outputs_alarms_and_events_have_the_names_of_the_api() {
    let tree = Tree::of(&status());
    for (id, kind, unit) in [
        ("machine.ready", Kind::Flag, ""),
        ("machine.ComponentName", Kind::Text, ""),
        ("gateway.SoftwareRevision", Kind::Text, ""),
        ("axis.z.cz_um", Kind::Number, "µm"),
        ("axis.z.verified_um", Kind::Number, "µm"),
        ("axis.z.acted", Kind::Texts, ""),
        ("axis.z.armed", Kind::Flag, ""),
        ("axis.z.probe.correction_um", Kind::Number, "µm"),
        ("axis.z.probe.last.error_um", Kind::Number, "µm"),
        ("signal.bed.value", Kind::Number, "degC"),
        ("signal.bed.quality", Kind::Text, ""),
        ("output.cnc_z.value", Kind::Number, "µm"),
        ("output.cnc_z.shares.base", Kind::Number, "µm"),
        ("output.cnc_z.state", Kind::Text, ""),
        ("device.module.state", Kind::Text, ""),
        ("alarms.count", Kind::Count, ""),
        ("alarms.text", Kind::Texts, ""),
        ("events.at", Kind::Texts, ""),
    ] {
        let found = variable(&tree, id);
        assert_eq!((found.kind, found.unit.as_str()), (kind, unit), "{id}");
        assert!(found.about.ends_with('.'), "{id}: {}", found.about);
    }
    assert_eq!(tree.probed, ["z"]);
    let machine = tree.objects.iter().find(|object| object.id == MACHINE).unwrap();
    assert_eq!((machine.name.as_str(), machine.label.as_str()), ("press", "研削盤"));
    assert_eq!(machine.role, Role::EventSource);
    for (id, parent) in
        [("Identification", "machine"), ("Components", "machine"), ("gateway.Identification", "gateway")]
    {
        let add_in = tree.objects.iter().find(|object| object.id == id).unwrap();
        assert_eq!((add_in.role, add_in.parent.as_deref()), (Role::AddIn, Some(parent)), "{id}");
    }
}

#[test]
fn an_identifier_does_not_depend_on_the_other_items_nor_on_the_state() {
    let before = Tree::of(&status());
    let mut changed = status();
    changed.signals.remove(0);
    changed.axes[0].probe = None;
    changed.axes[0].state = "holding";
    changed.alarms.clear();
    let after = Tree::of(&changed);
    let ids = |tree: &Tree| tree.variables.iter().map(|found| found.id.clone()).collect::<BTreeSet<_>>();
    let gone: BTreeSet<String> = ids(&before).difference(&ids(&after)).cloned().collect();
    assert!(gone.iter().all(|id| id.starts_with("signal.bed.")), "{gone:?}");
    assert!(ids(&after).is_subset(&ids(&before)));
}
