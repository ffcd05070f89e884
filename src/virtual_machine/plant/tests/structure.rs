//! Tests of a structure with modes, for the shipped column.

use super::super::structure::dot;
use super::*;

/// The column alone in a closed room. No heat flows to the air outside, and no source is switched on.
const CLOSED: &str = r#"
start = "2026-01-05T06:00:00Z"
soak  = "1s"
link  = [{ between = ["rails_3", "head"], conductance = 5.0 }, { between = ["head", "room"], conductance = 9.0 }]
[structure]
modes    = "column-hmc/modes.json"
initial  = 30.0
position = "scale_y"
axes     = { y = "y", z = "z" }
sinks    = { air_low = "room", air_high = "room", covers = "room", inside = "room", foot = "bed" }
[ambient]
mean          = 5.0
amplitude     = 0.0
peak_hour     = 15.0
drift_per_day = 0.0
weather       = 0.0
[duty]
on_after = ["100h", "100h"]
work     = ["1h", "1h"]
pause    = ["1h", "1h"]
[node]
head = { capacity = 1.5e5, initial = 60.0 }
room = { capacity = 5.0e5, initial = 20.0 }
bed  = { capacity = 1.2e6, initial = 15.0 }
[sensor.front]
node       = "column_front_3"
lag        = "0s"
resolution = 0.0
noise      = 0.0
[position.scale_y]
middle = 840.0
stroke = 1000.0
period = "25min"
"#;

fn closed(changes: &[(&str, &str)]) -> Result<PlantSpec, PlantError> {
    let changed = changes.iter().fold(CLOSED.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    });
    PlantSpec::parse(&changed)
}

fn begun(spec: &PlantSpec) -> Plant {
    Plant::new(spec, NOMINAL, spec.start())
}

/// Total heat above 0 °C, J.
fn heat(plant: &Plant) -> f64 {
    let nodes: f64 =
        plant.spec.nodes.iter().zip(&plant.warm.nodes).map(|(node, warm)| node.capacity * warm).sum();
    nodes + dot(&plant.spec.structure.as_ref().unwrap().uniform, &plant.warm.modes)
}

#[test]
fn no_heat_is_made_or_lost_between_the_structure_and_what_is_around_it() {
    let mut plant = begun(&closed(&[]).unwrap());
    let before = heat(&plant);
    for hours in [1, 10, 60] {
        after(&mut plant, hours * HOUR);
        // The heat flow to the sinks is taken from the start of a step. The error is half a step, once in the whole
        // run.
        let far = heat(&plant) / before - 1.0;
        assert!(far.abs() < 1e-5, "{far} after {hours} h");
    }
    let (first, last) = (degrees(&plant, "room"), plant.sensor("front").unwrap());
    assert!((first - last).abs() < 0.05, "all of one temperature in the end: {first}, {last}");
}

#[test]
fn a_structure_as_warm_as_everything_around_it_stays_so_and_does_not_move() {
    let alike = [("= 30.0", "= 23.5"), ("= 60.0", "= 23.5"), ("= 20.0", "= 23.5"), ("= 15.0 }", "= 23.5 }")];
    let mut plant = begun(&closed(&alike).unwrap());
    for minutes in [1, 60, 600] {
        after(&mut plant, minutes * 60);
        let front = plant.sensor("front").unwrap();
        assert!((front - 23.5).abs() < 1e-4, "{front}");
        for axis in ["y", "z"] {
            let moved = plant.true_error_um(axis).unwrap();
            assert!(moved.abs() < 1e-3, "{axis}: {moved} um");
        }
    }
}

#[test]
fn an_axis_moves_as_the_guideway_does_where_it_stands() {
    let mut plant = begun(&closed(&[]).unwrap());
    after(&mut plant, 3 * HOUR + 100);
    let position = plant.sensor("scale_y").unwrap();
    let structure = plant.spec.structure.as_ref().unwrap();
    let rise: Vec<f64> =
        plant.warm.modes.iter().zip(&plant.zero.modes).map(|(now, zero)| now - zero).collect();
    let high = structure.guide.iter().position(|point| *point > position).unwrap();
    let share = (position - structure.guide[high - 1]) / (structure.guide[high] - structure.guide[high - 1]);
    let at = |point: usize| dot(&structure.moves[1][point], &rise);
    let wanted = at(high - 1) + share * (at(high) - at(high - 1));
    assert!((plant.true_error_um("y").unwrap() - wanted).abs() < 1e-9 && wanted.abs() > 1.0, "{wanted} um");
}

#[test]
fn what_is_wrong_around_a_structure_is_reported_by_name() {
    let wrong = |changes: &[(&str, &str)]| closed(changes).unwrap_err().to_string();
    assert_eq!(
        wrong(&[("column-hmc/modes.json", "collum.json")]),
        "structure.modes: there is no file `collum.json`"
    );
    let reported =
        wrong(&[("foot = \"bed\"", "feet = \"bed\""), ("air_low = \"room\"", "air_low = \"rails_1\"")]);
    for part in [
        "structure.sinks: there is no sink `feet`; allowed: air_high, air_low, covers, foot, inside",
        "structure.sinks.foot: is missing; write the name of a node, or ambient",
        "structure.sinks.air_low: `rails_1` is a part of the structure; write the name of a node, or ambient",
    ] {
        assert!(reported.contains(part), "{reported}");
    }
    let reported = wrong(&[("\"rails_3\", \"head\"", "\"rails_3\", \"rails_4\"")]);
    assert!(
        reported.contains("link between rails_3 and rails_4: at least one of the two must be a node"),
        "{reported}"
    );
    let reported = wrong(&[("\"rails_3\", \"head\"", "\"head\", \"column_front_3\"")]);
    assert!(
        reported.contains("a measuring point of the structure cannot be linked; link a port"),
        "{reported}"
    );
    let reported = wrong(&[("\nroom = ", "\nrails_2 = { capacity = 1e5, initial = 20.0 }\nroom = ")]);
    assert!(reported.contains("`rails_2` is used twice among the nodes, ports and points"), "{reported}");
    let reported = wrong(&[("conductance = 5.0", "conductance = 5.0e5")]);
    assert!(
        reported.contains("structure: links of 500000 W/K in total are too much for a port that 1 W warms"),
        "{reported}"
    );
    let reported = wrong(&[("position = \"scale_y\"", "position = \"scale_x\"")]);
    assert_eq!(reported, "structure.position: there is no position `scale_x`");
}

#[test]
fn a_file_of_modes_that_does_not_fit_together_is_refused() {
    let modes = r#"{"format": "isotherm-modes", "version": 1, "rate_per_s": [0.1, 0.2], "uniform": [1.0],
        "ports": {}, "sinks": {}, "points": {}, "guide_mm": [2.0, 1.0], "moves_um": {"x": [], "y": [], "z": [[1.0, 2.0], [1.0, 2.0]]}}"#;
    let reported =
        |text: &str| PlantSpec::parse_with(CLOSED, &|_| Some(text.to_owned())).unwrap_err().to_string();
    assert_eq!(
        reported(modes).lines().collect::<Vec<_>>(),
        [
            "column-hmc/modes.json: uniform: 2 finite numbers are required, one for each mode",
            "column-hmc/modes.json: moves_um.x: 2 rows are required, one for each point of guide_mm",
            "column-hmc/modes.json: moves_um.y: 2 rows are required, one for each point of guide_mm",
            "column-hmc/modes.json: guide_mm: ascending points in mm are required",
        ]
    );
    assert!(reported("{}").contains("column-hmc/modes.json: missing field `format`"), "{}", reported("{}"));
}
