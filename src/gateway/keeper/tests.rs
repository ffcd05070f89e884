use super::*;

fn desk(directory: &Path, header: &str) -> Desk {
    Desk {
        directory: directory.to_owned(),
        machine: "m".to_owned(),
        header: header.to_owned(),
        state: directory.join("m.state.json"),
        keep: Duration::from_secs(2 * 86400),
        day: String::new(),
        file: None,
        failing: BTreeMap::new(),
        torn: Arc::default(),
        journal: Arc::new(Journal::default()),
    }
}

const DAY: Duration = Duration::from_secs(86400);

fn noon() -> Moment {
    Moment::default().after(DAY * 20_000 + DAY / 2)
}

fn names(directory: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(directory).unwrap();
    let mut names: Vec<_> =
        entries.map(|entry| entry.unwrap().file_name().to_str().unwrap().to_owned()).collect();
    names.sort();
    names
}

#[test]
fn each_day_has_its_own_file_and_old_ones_go() {
    let directory = tempfile::tempdir().unwrap();
    let other = directory.path().join("other-2001-01-01.csv");
    std::fs::write(&other, "not ours").unwrap();
    let mut desk = desk(directory.path(), "time,a\n");
    for day in 0..5 {
        desk.write_row(noon().after(DAY * day), b"row\n").unwrap();
    }
    let names = names(directory.path());
    assert_eq!(names.len(), 4, "three days and what is not ours: {names:?}");
    assert!(other.exists());
    let text = std::fs::read_to_string(directory.path().join(&names[0])).unwrap();
    assert_eq!(text, "time,a\nrow\n");
}

#[test]
fn a_log_with_other_columns_is_left_as_it_is_and_a_new_one_begins_beside_it() {
    let directory = tempfile::tempdir().unwrap();
    desk(directory.path(), "time,a\n").write_row(noon(), b"old\n").unwrap();
    desk(directory.path(), "time,a,b\n").write_row(noon(), b"new\n").unwrap();
    desk(directory.path(), "time,a,b\n").write_row(noon(), b"more\n").unwrap();
    let names = names(directory.path());
    let read = |name: &String| std::fs::read_to_string(directory.path().join(name)).unwrap();
    let texts: Vec<String> = names.iter().map(read).collect();
    assert_eq!(texts.len(), 2, "{names:?}");
    assert!(
        texts.contains(&"time,a\nold\n".to_owned()) && texts.contains(&"time,a,b\nnew\nmore\n".to_owned())
    );
}

#[test]
fn a_row_that_a_power_cut_left_half_written_does_not_swallow_the_next() {
    let directory = tempfile::tempdir().unwrap();
    let mut first = desk(directory.path(), "time,a\n");
    first.write_row(noon(), b"row\n").unwrap();
    first.write_row(noon(), b"hal").unwrap();
    desk(directory.path(), "time,a\n").write_row(noon(), b"row\n").unwrap();
    assert_eq!(names(directory.path()).len(), 2);
}

#[test]
fn what_a_full_queue_costs_is_counted() {
    let (queue, jobs) = sync_channel(1);
    let mut keeper = Keeper { queue: Some(queue), ..Keeper::default() };
    for _ in 0..4 {
        keeper.hand_over(Job::Row(noon(), Vec::new()));
    }
    assert_eq!(keeper.dropped(), 3);
    assert!(keeper.torn.load(Ordering::Relaxed), "the next row tells where the axes stand");
    drop(jobs);
}
