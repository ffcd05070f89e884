use std::time::Duration;

use super::*;

mod structure;

const HOUR: u64 = 3600;
/// Seed of the day from which the shipped coefficients were identified.
const NOMINAL: u64 = 100;

fn plant(machine: &str, seed: u64) -> Plant {
    let spec = PlantSpec::shipped(machine).unwrap().unwrap();
    Plant::new(&spec, seed, spec.start())
}

fn after(plant: &mut Plant, seconds: u64) {
    let moment = plant.begin.after(Duration::from_secs(seconds));
    plant.advance_to(moment);
}

/// Exact temperature of a node, °C.
fn degrees(plant: &Plant, name: &str) -> f64 {
    plant.warm.nodes[plant.spec.nodes.iter().position(|node| node.name == name).unwrap()]
}

/// Temperature rise of a node, K, in the hour that ends at `hour`.
fn slope(plant: &mut Plant, node: &str, hour: u64) -> f64 {
    after(plant, (hour - 1) * HOUR);
    let before = degrees(plant, node);
    after(plant, hour * HOUR);
    degrees(plant, node) - before
}

#[test]
fn the_numbers_at_a_moment_do_not_depend_on_how_often_it_was_asked() {
    let (mut often, mut seldom) = (plant("surface-grinder", 3), plant("surface-grinder", 3));
    for minute in 1..=90u64 {
        for tenth in 1..=600 {
            let millis = (minute - 1) * 60_000 + tenth * 100;
            often.advance_to(often.begin.after(Duration::from_millis(millis)));
            let _ = often.sensor("bed");
        }
        after(&mut seldom, minute * 60);
        for signal in ["bed", "wheelhead", "scale_z", "hydraulics_on", "cnc_on"] {
            assert_eq!(
                often.sensor(signal).unwrap().to_bits(),
                seldom.sensor(signal).unwrap().to_bits(),
                "{signal} after {minute} min"
            );
        }
        assert_eq!(often.true_error_um("z").unwrap().to_bits(), seldom.true_error_um("z").unwrap().to_bits());
    }
}

#[test]
fn the_beds_top_still_rises_after_twenty_hours() {
    for seed in [NOMINAL, 1, 2, 3] {
        let mut grinder = plant("surface-grinder", seed);
        assert!(slope(&mut grinder, "bed_top", 20) > 0.05);
    }
}

#[test]
fn the_wheelheads_case_bends_at_two_and_a_half_hours() {
    for seed in [NOMINAL, 1, 2, 3] {
        let mut grinder = plant("surface-grinder", seed);
        let first = slope(&mut grinder, "wheelhead", 1);
        let second = slope(&mut grinder, "wheelhead", 2);
        let fourth = slope(&mut grinder, "wheelhead", 4);
        assert!(first > 1.0 && second > 0.5 * first, "still rising: {first}, {second}");
        assert!(fourth < 0.25 * first, "{first} then {fourth}");
        let late = slope(&mut grinder, "wheelhead", 8);
        assert!(late < 0.25 * first, "{first} then {late}");
    }
}

#[test]
fn the_grinders_error_is_about_minus_twenty_after_six_hours() {
    let mut grinder = plant("surface-grinder", NOMINAL);
    after(&mut grinder, 6 * HOUR);
    let error = grinder.true_error_um("z").unwrap();
    assert!((-26.0..=-16.0).contains(&error), "{error}");
}

#[test]
fn the_edms_error_is_largest_in_the_early_afternoon_and_returns() {
    let mut edm = plant("sinker-edm", NOMINAL);
    let (mut worst, mut worst_at) = (0.0, 0);
    for minute in 0..=18 * 60 {
        after(&mut edm, minute * 60);
        let error = edm.true_error_um("z").unwrap();
        if error < worst {
            (worst, worst_at) = (error, minute);
        }
    }
    let clock = 6.0 + f64::from(u32::try_from(worst_at).unwrap()) / 60.0;
    assert!((-30.0..=-18.0).contains(&worst), "{worst}");
    assert!((14.0..=15.5).contains(&clock), "{clock}");
    let mut edm = plant("sinker-edm", NOMINAL);
    after(&mut edm, (worst_at + 240) * 60);
    assert!(edm.true_error_um("z").unwrap() > worst + 5.0);
}

#[test]
fn a_seed_repeats_its_day_and_another_one_has_another() {
    let error = |seed| {
        let mut grinder = plant("surface-grinder", seed);
        after(&mut grinder, 5 * HOUR);
        (grinder.true_error_um("z").unwrap(), grinder.warm.air, grinder.sensor("bed").unwrap())
    };
    assert_eq!(error(7), error(7));
    let (seventh, eighth) = (error(7), error(8));
    assert!((seventh.0 - eighth.0).abs() > 0.1 && (seventh.1 - eighth.1).abs() > 0.01);
}

#[test]
fn the_machine_is_switched_on_shortly_after_the_start_and_stays_on() {
    let mut grinder = plant("surface-grinder", 5);
    let on = |plant: &Plant| plant.sensor("hydraulics_on").unwrap() > 0.5;
    assert!(!on(&grinder));
    after(&mut grinder, 170);
    assert!(!on(&grinder));
    for minute in 8..600 {
        after(&mut grinder, minute * 60);
        assert!(on(&grinder));
    }
}

#[test]
fn a_sensor_shows_tenths_and_feels_its_part_late() {
    let mut grinder = plant("surface-grinder", NOMINAL);
    after(&mut grinder, HOUR);
    let shown = grinder.sensor("bed").unwrap();
    assert!((shown * 10.0 - (shown * 10.0).round()).abs() < 1e-9);
    let spec = PlantSpec::shipped("surface-grinder").unwrap().unwrap();
    let place = spec.sensors.iter().position(|sensor| sensor.signal == "wheelhead").unwrap();
    let there = spec.sensors[place].feels(&spec, &grinder.warm);
    assert!(grinder.sensors[place].felt < there, "a part that warms is ahead of its sensor");
}

#[test]
fn what_the_plant_does_not_know_has_no_value() {
    let grinder = plant("surface-grinder", 1);
    assert_eq!(grinder.sensor("coolant"), None);
    assert_eq!(grinder.true_error_um("x"), None);
    assert!(PlantSpec::shipped("lathe").is_none());
}

#[test]
fn a_wrong_plant_file_says_where_and_what_is_allowed() {
    let good = include_str!("../../../profiles/sinker-edm.plant.toml");
    let broken =
        good.replace("[node.ram] ", "[node.rum] ").replace("conductance = 24.0", "conductance = -24.0");
    let error = PlantSpec::parse(&broken).unwrap_err().to_string();
    assert!(
        error.contains(
            "link between ram and ambient: there is no node `ram`; allowed: column, head, rum, table, ambient"
        ),
        "{error}"
    );
    assert!(error.contains("conductance -24 W/K; must be more than 0"), "{error}");
    let unknown = good.replace("resolution = 0.1", "resolutoin = 0.1");
    let error = PlantSpec::parse(&unknown).unwrap_err().to_string();
    assert!(error.contains("line 77, column 1") && error.contains("resolutoin"), "{error}");
    let unstable = good.replace("capacity = 4.0e4", "capacity = 40.0");
    let error = PlantSpec::parse(&unstable).unwrap_err().to_string();
    assert!(
        error.contains("node.ram: links of 32 W/K in total are too much for a capacity of 40 J/K"),
        "{error}"
    );
}

/// The electric discharge machine with a ram that expands along a travel.
fn with_a_travel(more: &str) -> PlantSpec {
    let good = include_str!("../../../profiles/sinker-edm.plant.toml");
    let travel = "[position.scale_z]\nmiddle = -50.0\nstroke = 300.0\nperiod = \"8min\"\n";
    PlantSpec::parse(&format!("{good}\n{travel}\n{more}")).unwrap_or_else(|error| panic!("{error}"))
}

/// Error of an additional axis with this text alone, the rises of both nodes, and the position.
fn error_along(more: &str, seconds: u64) -> (f64, f64, f64, f64) {
    let spec = with_a_travel(more);
    let mut plant = Plant::new(&spec, NOMINAL, spec.start());
    after(&mut plant, seconds);
    let rise = |name: &str| {
        let place = spec.nodes.iter().position(|node| node.name == name).unwrap();
        plant.warm.nodes[place] - plant.zero.nodes[place]
    };
    (plant.true_error_um("u").unwrap(), rise("ram"), rise("column"), plant.sensor("scale_z").unwrap())
}

#[test]
fn a_part_along_the_travel_counts_by_what_of_it_lies_between_reference_and_position() {
    let screw = "[[stretch]]\naxis = \"u\"\nnode = \"ram\"\ncoefficient = 1e-5\nposition = \"scale_z\"\n\
                 reference_mm = 0.0\nfrom_mm = -100.0\nto_mm = 20.0\nsign = 1\n";
    for seconds in [0, 40, 80, 300, 360].map(|later| 3 * HOUR + later) {
        let (error, ram, _, position) = error_along(screw, seconds);
        let counts = position.clamp(-100.0, 20.0);
        assert!((error - 0.01 * ram * counts).abs() < 1e-9, "{position} mm: {error} um");
    }
    let (error, _, _, position) = error_along(screw, 3 * HOUR + 120);
    assert!((position + 200.0).abs() < 1e-6 && error < -0.1, "{position} mm: {error} um");
}

#[test]
fn a_tilt_grows_with_the_difference_and_the_distance() {
    let tilt = "[[tilt]]\naxis = \"u\"\nwarm = \"ram\"\ncold = \"column\"\num_per_mm_kelvin = 0.02\n\
                position = \"scale_z\"\nreference_mm = 10.0\n";
    let (error, ram, column, position) = error_along(tilt, 4 * HOUR);
    assert!((error - 0.02 * (ram - column) * (position - 10.0)).abs() < 1e-9);
}

#[test]
fn a_travel_that_is_not_there_is_named() {
    let good = include_str!("../../../profiles/sinker-edm.plant.toml");
    let wrong = "[[stretch]]\naxis = \"u\"\nnode = \"ram\"\ncoefficient = 1e-5\nposition = \"scale_y\"\n\
                 reference_mm = 0.0\nsign = 1\n";
    let error = PlantSpec::parse(&format!("{good}\n{wrong}")).unwrap_err().to_string();
    assert_eq!(error, "stretch of axis u by ram: there is no position `scale_y`");
}

#[test]
fn a_spell_of_work_has_a_load_of_its_own() {
    let spec = PlantSpec::shipped("xc100-lathe").unwrap().unwrap();
    let [lightest, hardest] = spec.duty.load;
    let mut duty = Duty::new(&spec.duty, 3);
    let mut seen: Vec<f64> = Vec::new();
    for step in 0..8 * HOUR {
        duty.advance_to(step);
        let share = duty.share(spec::When::Work);
        assert!(share.total_cmp(&0.0).is_eq() || (lightest..=hardest).contains(&share));
        if share > 0.0 && seen.last().is_none_or(|last| (last - share).abs() > 1e-9) {
            seen.push(share);
        }
    }
    assert!(seen.len() >= 4, "{seen:?}");
}

#[test]
fn a_plant_tells_what_its_source_reports() {
    let spec = PlantSpec::shipped("xc100-lathe").unwrap().unwrap();
    let published = spec.published().unwrap();
    assert!(published.text.contains("Tachiya"));
    let x = PublishedAxis { name: "x".to_owned(), uncompensated_um: Some(19.0), compensated_um: Some(8.0) };
    assert_eq!(published.axes, [x]);
}
