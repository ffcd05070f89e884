//! Products of the runs of a fleet, stored for each machine, summed, and used for identification.

use isotherm_identify::Learned;
use isotherm_identify::fleet::{FleetTerm, RunProducts};
use isotherm_identify::method::{Method, Settings};
use isotherm_identify::setup::{Choice, ready};

use super::rig::{self, choice, dataset, found, profile};
use super::whitened::{days, logs};

/// Products of these days of a machine, after they have been written to a file and read.
fn kept(machine: &str, days: &[String], choice: &Choice) -> RunProducts {
    let dataset = dataset(days).unwrap();
    let ready = ready(&profile(4), &dataset, choice).unwrap();
    let products = RunProducts::of(&ready, machine, &Settings::default()).unwrap();
    let file = products.to_json().unwrap();
    let read = RunProducts::from_json(file.as_bytes()).unwrap();
    assert_eq!(read, products, "the file has every digit");
    read
}

fn some(count: u64) -> Vec<String> {
    logs(&days(count, 11, 1.0))
}

#[test]
fn what_is_learnt_from_products_kept_day_by_day_is_what_identify_finds_in_the_records_to_the_last_bit() {
    // One day, two, and more, up to a number that is divided into folds.
    for count in [1, 2, 5, 10] {
        let days = some(count);
        let found = found(4, &days, &Settings::default());
        let fleet = merged(&days).learn();
        let (gains, halves) = match &found.learned {
            Learned::Mean { gains, halves } => (gains, Some(halves)),
            Learned::Sum(gains) => (gains, None),
            Learned::Net { .. } => panic!("no network was asked for"),
        };
        assert!(gains.len() > 4, "{gains:?}");
        // `identify` removes terms with less than half a count of the register.
        assert!(fleet.terms.len() >= gains.len());
        for (place, term) in found.terms.iter().enumerate() {
            let same =
                |own: &&FleetTerm| own.signal == term.signal && own.lag_s.to_bits() == term.lag_s.to_bits();
            let own = fleet.terms.iter().find(same).unwrap();
            assert_eq!(own.gain.to_bits(), gains[place].1.to_bits(), "{own:?} {term:?}");
            assert_eq!(own.halves, halves.map(|halves| halves[place]));
        }
        for (own, run) in fleet.runs.iter().zip(&found.runs) {
            assert!((own.uncompensated_rms_um - run.uncompensated_rmse_um).abs() < 1e-9, "{own:?} {run:?}");
            assert!((own.rms_um.unwrap() - run.rmse_um).abs() < 1e-6, "{own:?} {run:?}");
        }
    }
}

/// Products in which each day is stored separately, like that of another machine.
fn merged(days: &[String]) -> RunProducts {
    let each =
        |(place, day): (usize, &String)| kept(&format!("mill-{place}"), std::slice::from_ref(day), &choice());
    let mut each = days.iter().enumerate().map(each).collect::<Vec<_>>().into_iter();
    let mut fleet = each.next().unwrap();
    each.for_each(|more| fleet.add(&more).unwrap());
    fleet
}

#[test]
fn a_machine_is_judged_by_the_others_as_well_and_a_profile_takes_the_block() {
    let days = some(4);
    let mut fleet = kept("mill-1", &days[..2], &choice());
    fleet.add(&kept("mill-2", &days[2..], &choice())).unwrap();
    assert_eq!(
        fleet.runs().collect::<Vec<_>>(),
        [("mill-1", "day0"), ("mill-1", "day1"), ("mill-2", "day0"), ("mill-2", "day1")]
    );
    let model = fleet.learn();
    // Products as if the first machine had no other run.
    let mut without = kept("mill-1", &days[..1], &choice());
    without.add(&kept("mill-2", &days[2..], &choice())).unwrap();
    let (own, others) = (&model.runs[0], &without.learn().runs[0]);
    assert_eq!(own.other_machines_rms_um, others.rms_um);
    assert_ne!(own.other_machines_rms_um, own.rms_um);
    assert!(
        kept("mill-1", &days, &choice()).learn().runs.iter().all(|run| run.other_machines_rms_um.is_none())
    );
    rig::pasted(&rig::profile_with(4, &model.block()), &[]);
}

#[test]
fn products_that_do_not_mean_the_same_are_not_added_and_why_is_said() {
    let days = some(2);
    let mut fleet = kept("mill-1", &days[..1], &choice());
    let before = fleet.clone();
    let mut refused = |other: &RunProducts, words: &[&str]| {
        let why = fleet.add(other).unwrap_err();
        words.iter().for_each(|word| assert!(why.contains(word), "`{word}` is not in: {why}"));
        assert_eq!(fleet, before);
    };
    let fewer = Choice { without: vec!["s3".to_owned()], ..choice() };
    refused(
        &kept("mill-2", &days[1..], &fewer),
        &["products of mill-1 have the column s3 (degC) without lag and 3 more, but those of mill-2 do not"],
    );
    let slower = Choice { resample: std::time::Duration::from_mins(5), ..choice() };
    refused(
        &kept("mill-2", &days[1..], &slower),
        &["the averaging time of the rows (--resample) is 60 s", "300 s in the products of mill-2"],
    );
    refused(&before, &["run day0 of mill-1 is in both files: a run may occur only once"]);
    let order = ["s3", "s1", "s0", "s2"].map(str::to_owned).to_vec();
    let turned = kept("mill-2", &days[1..], &Choice { inputs: order, ..choice() });
    fleet.add(&turned).unwrap();
    let mut straight = before.clone();
    straight.add(&kept("mill-2", &days[1..], &choice())).unwrap();
    assert_eq!(fleet, straight, "their order is no difference");
}

#[test]
fn products_that_were_changed_are_of_another_version_or_are_none_are_refused() {
    let file = kept("mill-1", &some(1), &choice()).to_json().unwrap();
    for (from, to, words) in [
        ("\"machine\":\"mill-1\"", "\"machine\":\"mill-7\"", "the checksum is wrong"),
        ("\"version\":1", "\"version\":2", "this program can only read run products of version 1"),
        ("isotherm-products", "isotherm-halves", "its format is not \"isotherm-products\""),
        ("{\"format\"", "[{\"format\"", "does not contain run products"),
    ] {
        assert!(file.contains(from), "{from}");
        let why = RunProducts::from_json(file.replacen(from, to, 1).as_bytes()).unwrap_err();
        assert!(why.contains(words), "{why}");
    }
    let dataset = dataset(&some(2)).unwrap();
    let ready = ready(&profile(4), &dataset, &choice()).unwrap();
    let ols = Settings { method: Method::Ols, ..Settings::default() };
    assert!(RunProducts::of(&ready, "mill-1", &ols).unwrap_err().contains("the method whitened"));
}
