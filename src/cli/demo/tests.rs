use super::*;

#[test]
fn every_machine_states_its_sources_figures_beside_ours() {
    for name in machines::names() {
        let (profile, plant) = machines::with_plant(name, &[]).unwrap();
        let published = plant.published().unwrap_or_else(|| panic!("{name}: no source is published"));
        let axes: Vec<&str> = profile.axes.iter().map(|axis| axis.settings.name.as_str()).collect();
        assert!(published.axes.iter().all(|figure| axes.contains(&figure.name.as_str())), "{name}");
        let lines = source_lines(published);
        assert!(
            lines[0].starts_with("Source of the machine: ") && lines.len() == 1 + published.axes.len(),
            "{lines:?}"
        );
    }
}
