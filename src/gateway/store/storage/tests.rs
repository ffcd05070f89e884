use super::thread::DayFile;
use super::*;
use crate::clock::Clock;
use isotherm_core::quantity::{Counts, time};

mod turns;

fn file(directory: &Path, header: &str) -> DayFile {
    DayFile::new(directory, "m", ".csv", header.to_owned())
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

fn nothing() -> Job {
    Job::Row { at: noon(), stamped: Stamped::default(), row: Vec::new() }
}

#[test]
fn each_day_has_its_own_file() {
    let directory = tempfile::tempdir().unwrap();
    let mut log = file(directory.path(), "time,a\n");
    for day in 0..3 {
        log.write(noon().after(DAY * day), Stamped::default(), b"row\n").unwrap();
    }
    let names = names(directory.path());
    assert_eq!(names, ["m-2024-10-04.csv", "m-2024-10-05.csv", "m-2024-10-06.csv"]);
    let text = std::fs::read_to_string(directory.path().join(&names[0])).unwrap();
    assert_eq!(text, "time,a\nrow\n");
}

#[test]
fn a_run_whose_clock_is_behind_the_last_row_begins_a_file_of_its_own() {
    let directory = tempfile::tempdir().unwrap();
    for (stamp, files) in
        [("2024-10-04T12:00:00Z", 1), ("2024-10-04T13:00:00Z", 1), ("2024-10-04T12:30:00Z", 2)]
    {
        let row = format!("{stamp},20.5\n");
        let at = time::parse(stamp).unwrap();
        file(directory.path(), "time,a\n").write(at, Stamped::default(), row.as_bytes()).unwrap();
        assert_eq!(names(directory.path()).len(), files, "{stamp}");
    }
}

#[test]
fn a_log_with_other_columns_is_left_as_it_is_and_a_new_one_begins_beside_it() {
    let directory = tempfile::tempdir().unwrap();
    file(directory.path(), "time,a\n").write(noon(), Stamped::default(), b"old\n").unwrap();
    file(directory.path(), "time,a,b\n").write(noon(), Stamped::default(), b"new\n").unwrap();
    file(directory.path(), "time,a,b\n").write(noon(), Stamped::default(), b"more\n").unwrap();
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
    let mut first = file(directory.path(), "time,a\n");
    first.write(noon(), Stamped::default(), b"row\n").unwrap();
    first.write(noon(), Stamped::default(), b"hal").unwrap();
    file(directory.path(), "time,a\n").write(noon(), Stamped::default(), b"row\n").unwrap();
    assert_eq!(names(directory.path()).len(), 2);
}

#[test]
fn what_a_full_queue_costs_is_counted() {
    let (queue, jobs) = sync_channel(1);
    let mut storage = Storage { queue: Some(queue), ..Storage::default() };
    for _ in 0..4 {
        storage.hand_over(nothing());
    }
    assert_eq!(storage.dropped(), 3);
    assert!(storage.torn.load(Ordering::Relaxed), "the next row tells where the axes stand");
    drop(jobs);
}

mod outputs {
    use super::*;
    use crate::gateway::store::log::outputs::{Entry, HEADER, OutputLogReader, OutputReplay, Replayed};
    use crate::gateway::store::log::sample;
    use isotherm_core::output::{Action, Controller, Fact, Input, Rules, Settings, State, Verify, Who};
    use isotherm_profile::OutputId;

    /// Day of noon in the tests.
    const DAY_ZERO: &str = "2024-10-04";
    const SECOND: Duration = Duration::from_secs(1);

    /// Gateway with one output, whose disk works on command.
    struct Bench {
        storage: Storage,
        jobs: Receiver<QueuedJob>,
        thread: StorageThread,
        settings: Settings,
        controller: Controller,
        known: Option<Controller>,
        now: Moment,
        action: Action,
        register: i64,
    }

    fn bench(directory: &Path) -> Bench {
        let mut profile = sample::profile();
        profile.history.keep = 2 * DAY;
        let (queue, jobs) = sync_channel(QUEUE + OUTPUT_QUEUE);
        let outputs = OutputsLog::of(["cnc_z", "heartbeat"].map(str::to_owned), (1, 0), queue.clone());
        let header = Recorder::header(&profile);
        let journal = Arc::new(Journal::by(&Clock::simulated(noon(), None)));
        let tears = (Arc::default(), outputs.tears());
        let thread = StorageThread::new(&profile, directory, header, tears, journal);
        let storage = Storage { queue: Some(queue), outputs, ..Storage::default() };
        let settings = Settings {
            step: Counts(2),
            limit: Counts(400),
            bias: Counts(0),
            range: (Counts(-32768), Counts(32767)),
            late: SECOND,
            remembered: 10 * SECOND,
            every: SECOND,
            refresh: None,
            is_shared: false,
            verify: Verify::Reading,
            applied: None,
            rules: Rules::default(),
        };
        let controller = Controller::new(&settings, State::new(&settings, None, noon()), 0, noon());
        Bench {
            storage,
            jobs,
            thread,
            settings,
            controller,
            known: None,
            now: noon(),
            action: Action::Nothing { until: noon() },
            register: 0,
        }
    }

    impl Bench {
        fn give(&mut self, fact: Fact) {
            let (before, known, input) = (self.controller, self.known, Input::Fact(fact));
            self.action = self.controller.step(&self.settings, input, self.now);
            let _ = self.controller.take_events();
            self.known = Some(self.controller);
            let stepped = OutputTransition {
                id: OutputId(0),
                settings: &self.settings,
                before: &before,
                is_continuous: known == Some(before),
                input,
                action: self.action,
                after: &self.controller,
            };
            self.storage.outputs.stepped(&stepped, self.now);
        }

        /// Runs this many seconds, in which the register is armed and moves to and fro.
        fn seconds(&mut self, count: u32) {
            for _ in 0..count {
                self.now = self.now.after(SECOND);
                self.give(Fact::Look);
                self.carry_out();
                self.give(Fact::Armed { by: Who::Person });
                self.carry_out();
                let offset = if self.register == 0 { 2 } else { 0 };
                self.give(Fact::Decided {
                    offset: Counts(offset),
                    target: None,
                    not_after: self.now.after(SECOND),
                });
                self.carry_out();
            }
        }

        fn carry_out(&mut self) {
            loop {
                let fact = match self.action {
                    Action::Nothing { .. } => return,
                    Action::Read => Fact::Read { found: Counts(self.register), asked: self.now },
                    Action::Keep => Fact::Kept,
                    Action::Write { value, .. } => {
                        self.register = value.0;
                        Fact::Done { left: self.now }
                    }
                };
                self.give(fact);
            }
        }

        /// Lets the disk store everything that waits.
        fn keep(&mut self) {
            while let Ok(job) = self.jobs.try_recv() {
                self.thread.take(*job);
            }
        }
    }

    /// Every file by name, with the number of its beginnings and of its confirmed actions. Each file is replayed by
    /// itself.
    fn files(directory: &Path) -> Vec<(String, usize, usize)> {
        let of = |name: String| {
            let file = std::fs::File::open(directory.join(&name)).unwrap();
            let mut reader = OutputLogReader::open(file, &name).unwrap();
            let (mut replay, mut begun, mut same) = (OutputReplay::default(), 0, 0);
            while let Some(row) = reader.next_row().unwrap() {
                begun += usize::from(matches!(row.entry, Entry::Begins(_)));
                match replay.row(&row) {
                    Replayed::Nothing => {}
                    Replayed::Same => same += 1,
                    other => panic!("{name}, line {}: {other:?}", row.line),
                }
            }
            (name, begun, same)
        };
        names(directory).into_iter().filter(|name| name.ends_with(".outputs.csv")).map(of).collect()
    }

    #[test]
    fn an_output_begins_once_in_a_file_and_again_in_that_of_the_next_day_and_old_files_go() {
        let directory = tempfile::tempdir().unwrap();
        let mut bench = bench(directory.path());
        for _ in 0..5 {
            bench.seconds(10);
            bench.now = bench.now.after(DAY);
        }
        bench.keep();
        let files = files(directory.path());
        assert_eq!(files.len(), 3, "the rest is older than it is kept: {files:?}");
        assert!(files.iter().all(|(_, begun, same)| *begun == 1 && *same >= 20), "{files:?}");
    }

    #[test]
    fn jobs_that_come_together_are_all_done_before_the_thread_ends() {
        let directory = tempfile::tempdir().unwrap();
        let mut bench = bench(directory.path());
        bench.seconds(10);
        bench.storage = Storage::default();
        bench.thread.work(&bench.jobs);
        let files = files(directory.path());
        assert!(files[0].1 == 1 && files[0].2 >= 20, "{files:?}");
    }

    #[test]
    fn a_look_that_shows_nothing_and_asks_for_nothing_leaves_no_row() {
        let directory = tempfile::tempdir().unwrap();
        let mut bench = bench(directory.path());
        bench.seconds(1);
        bench.keep();
        let before = files(directory.path());
        (0..100).for_each(|_| bench.give(Fact::Look));
        bench.keep();
        assert_eq!(files(directory.path()), before);
    }

    #[test]
    fn behind_rows_that_found_the_queue_full_the_output_begins_anew() {
        let directory = tempfile::tempdir().unwrap();
        let mut bench = bench(directory.path());
        bench.seconds(3000);
        assert!(bench.storage.dropped() > 0);
        bench.keep();
        bench.seconds(10);
        bench.keep();
        let files = files(directory.path());
        assert_eq!(files[0].1, 2, "{files:?}");
    }

    #[test]
    fn the_decisions_have_room_in_a_queue_that_is_full_of_rows_of_outputs() {
        let directory = tempfile::tempdir().unwrap();
        let mut bench = bench(directory.path());
        bench.seconds(3000);
        let dropped = bench.storage.dropped();
        let has_room = (0..QUEUE).all(|_| bench.storage.hand_over(nothing()));
        assert!(has_room);
        assert_eq!(bench.storage.dropped(), dropped);
    }

    #[test]
    fn what_waits_behind_a_row_that_the_disk_did_not_take_is_left_out_until_the_output_begins_anew() {
        let directory = tempfile::tempdir().unwrap();
        let mut bench = bench(directory.path());
        bench.seconds(10);
        bench.keep();
        bench.now = bench.now.after(DAY);
        let day: String = bench.now.to_string().chars().take(10).collect();
        // A directory at this path cannot be written.
        let blocked = directory.path().join(names(directory.path()).remove(0).replace(DAY_ZERO, &day));
        std::fs::create_dir(&blocked).unwrap();
        bench.seconds(10);
        bench.keep();
        std::fs::remove_dir(&blocked).unwrap();
        bench.seconds(10);
        bench.keep();
        let files = files(directory.path());
        assert_eq!(files.len(), 2, "{files:?}");
        assert!(files[1].1 == 1 && files[1].2 >= 10, "{files:?}");
    }

    #[test]
    fn what_is_written_again_and_again_is_counted_each_minute() {
        let directory = tempfile::tempdir().unwrap();
        let mut bench = bench(directory.path());
        for second in 0..130u32 {
            let at = noon().after(SECOND * second);
            bench.storage.outputs.wrote(CountedWrite::Heartbeat, at);
            if second == 70 || second == 71 {
                bench.storage.outputs.not_written(CountedWrite::Heartbeat, &"no answer within 100ms", at);
            }
        }
        bench.storage.outputs.count_for_the_last_time(noon().after(SECOND * 130));
        bench.keep();
        let name = names(directory.path()).remove(0);
        let text = std::fs::read_to_string(directory.path().join(name)).unwrap();
        let rows: Vec<_> = text.strip_prefix(HEADER).unwrap().lines().collect();
        let reported: Vec<String> =
            rows.iter().map(|row| row.split(',').skip(1).take(3).collect::<Vec<_>>().join(" ")).collect();
        assert_eq!(
            reported,
            [
                "heartbeat writes 60",
                "heartbeat fault ",
                "heartbeat fault ",
                "heartbeat writes 60",
                "heartbeat failures 2",
                "heartbeat writes 10"
            ]
        );
    }
}
