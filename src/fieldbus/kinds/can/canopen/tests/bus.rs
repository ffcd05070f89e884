//! Test of the SDO client with a server of the virtual machine, over a bus that loses and delays frames.

use std::collections::VecDeque;

use proptest::prelude::*;

use super::super::sdo::{Client, Progress};
use super::*;
use crate::fieldbus::error::Fault;
use crate::virtual_machine::can::dictionary::{Dictionary, Server};
use isotherm_core::codec::Entry;

/// Effect of the bus on one frame.
#[derive(Clone, Copy, Debug)]
enum Fate {
    Arrives,
    IsLost,
    /// The frame and all later ones wait for this number of steps, because a bus keeps the order.
    Waits(u8),
}

fn fates() -> impl Strategy<Value = Vec<Fate>> {
    let fate = prop_oneof![
        8 => Just(Fate::Arrives),
        1 => Just(Fate::IsLost),
        2 => (1..60u8).prop_map(Fate::Waits),
    ];
    prop::collection::vec(fate, 1..200)
}

/// One direction of the bus, with the frames that are under way.
struct Way {
    frames: VecDeque<(u32, Frame)>,
}

impl Way {
    fn send(&mut self, frame: Frame, now: u32, fate: Fate) {
        let due = match fate {
            Fate::Arrives => now + 1,
            Fate::IsLost => return,
            Fate::Waits(steps) => now + u32::from(steps),
        };
        let last = self.frames.back().map_or(0, |(due, _)| *due);
        self.frames.push_back((due.max(last), frame));
    }

    fn arrive(&mut self, now: u32) -> Option<Frame> {
        let is_due = self.frames.front().is_some_and(|(due, _)| *due <= now);
        if is_due { self.frames.pop_front().map(|(_, frame)| frame) } else { None }
    }
}

struct Bus {
    client: Client,
    server: Server,
    objects: Dictionary,
    out: Way,
    back: Way,
    now: u32,
    fates: std::iter::Cycle<std::vec::IntoIter<Fate>>,
}

/// Timeout of a request, in steps. It is longer than two lost frames need, and shorter than the longest delay, so that
/// late answers occur.
const PATIENCE: u32 = 40;

impl Bus {
    fn new(fates: Vec<Fate>, objects: Dictionary) -> Bus {
        Bus {
            client: Client::new(node(5)),
            server: Server::default(),
            objects,
            out: Way { frames: VecDeque::new() },
            back: Way { frames: VecDeque::new() },
            now: 0,
            fates: fates.into_iter().cycle(),
        }
    }

    fn fate(&mut self) -> Fate {
        self.fates.next().unwrap()
    }

    fn run(&mut self, first: Frame) -> Result<Option<Vec<u8>>, Fault> {
        let mut sending = Some(first);
        loop {
            if let Some(frame) = sending.take() {
                let fate = self.fate();
                self.out.send(frame, self.now, fate);
            }
            let until = self.now + PATIENCE;
            while self.now < until && sending.is_none() {
                self.now += 1;
                while let Some(frame) = self.out.arrive(self.now) {
                    if let Some(answer) = self.server.serve(frame.data(), &mut self.objects).answer {
                        let fate = self.fate();
                        self.back.send(self::frame(0x585, &answer), self.now, fate);
                    }
                }
                while let Some(frame) = self.back.arrive(self.now) {
                    match self.client.take(&frame) {
                        None => {}
                        Some(Progress::Send(frame) | Progress::Begin(frame)) => sending = Some(frame),
                        Some(Progress::Read(data)) => return Ok(Some(data.bytes().to_vec())),
                        Some(Progress::Written) => return Ok(None),
                        Some(Progress::Failed(error, abort)) => return Err(self.failed(error, abort)),
                    }
                }
            }
            if sending.is_none() {
                let abort = self.client.timed_out();
                return Err(self.failed(Fault::Timeout, abort));
            }
        }
    }

    fn failed(&mut self, error: Fault, abort: Option<Frame>) -> Fault {
        if let Some(abort) = abort {
            let fate = self.fate();
            self.out.send(abort, self.now, fate);
        }
        error
    }
}

const NAME: Entry = Entry::new(0x1008, 0);
const SHORT: Entry = Entry::new(0x2000, 1);
const LONG: Entry = Entry::new(0x2001, 0);

fn objects(name: &[u8], long: usize) -> Dictionary {
    let mut objects = Dictionary::default();
    objects.put(Entry::new(0x1000, 0), &[0x94, 1, 0, 0], false);
    objects.put(NAME, name, false);
    objects.put(SHORT, &[0; 4], true);
    objects.put(LONG, &vec![0; long], true);
    objects
}

proptest! {
    #[test]
    fn over_a_bus_that_loses_and_delays_data_is_right_or_there_is_an_error(
        fates in fates(),
        name in prop::collection::vec(any::<u8>(), 0..60),
        long in 0..40usize,
        jobs in prop::collection::vec(0..4u8, 1..12),
    ) {
        let mut bus = Bus::new(fates, objects(&name, long));
        let mut short = vec![0; 4];
        let mut may_be_written: Vec<Vec<u8>> = vec![short.clone()];
        for (round, job) in jobs.into_iter().enumerate() {
            let mark = u8::try_from(round + 1).unwrap();
            match job {
                0 => {
                    let first = bus.client.read(NAME);
                    if let Ok(read) = bus.run(first) {
                        prop_assert_eq!(read, Some(name.clone()));
                    }
                }
                1 => {
                    short = vec![mark; 4];
                    may_be_written.push(short.clone());
                    let first = bus.client.write(SHORT, &short);
                    if bus.run(first).is_ok() {
                        prop_assert_eq!(bus.objects.get(Entry::new(0x2000, 1)), Some(short.as_slice()));
                        may_be_written = vec![short.clone()];
                    }
                }
                2 => {
                    let first = bus.client.read(SHORT);
                    if let Ok(read) = bus.run(first) {
                        let read = read.unwrap();
                        prop_assert!(may_be_written.contains(&read), "{:?} was never there", read);
                        may_be_written = vec![read];
                    }
                }
                _ => {
                    let bytes = vec![mark; long];
                    let first = bus.client.write(LONG, &bytes);
                    if bus.run(first).is_ok() {
                        prop_assert_eq!(bus.objects.get(Entry::new(0x2001, 0)), Some(bytes.as_slice()));
                    }
                }
            }
        }
    }

    #[test]
    fn over_a_good_bus_everything_is_read_and_written(
        name in prop::collection::vec(any::<u8>(), 0..200),
        long in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        let mut bus = Bus::new(vec![Fate::Arrives], objects(&name, long.len()));
        let first = bus.client.read(NAME);
        prop_assert_eq!(bus.run(first), Ok(Some(name)));
        let first = bus.client.write(LONG, &long);
        prop_assert_eq!(bus.run(first), Ok(None));
        let first = bus.client.read(LONG);
        prop_assert_eq!(bus.run(first), Ok(Some(long)));
    }

    #[test]
    fn no_frame_however_odd_makes_the_client_the_server_or_the_master_panic(
        frames in prop::collection::vec((0..0x800u16, prop::collection::vec(any::<u8>(), 0..9)), 0..200),
        write in prop::option::of(prop::collection::vec(any::<u8>(), 0..30)),
    ) {
        let mut client = Client::new(node(5));
        let mut server = Server::default();
        let mut objects = objects(b"a name of some length", 12);
        let mut master = super::master::of_three_nodes();
        match &write {
            Some(data) => client.write(NAME, data),
            None => client.read(NAME),
        };
        let mut outputs = Vec::new();
        for (raw, data) in frames {
            server.serve(&data, &mut objects);
            let _ = client.take(&frame(0x585, &data));
            master.take(&frame(raw, &data), Default::default(), &mut outputs);
            master.take(&frame(0x701 + raw % 4, &data), Default::default(), &mut outputs);
        }
    }
}

#[test]
fn what_the_node_has_not_or_does_not_let_write_is_refused_in_words() {
    let mut bus = Bus::new(vec![Fate::Arrives], objects(b"x", 3));
    let mut reported = |entry, data: Option<&[u8]>| {
        let first = match data {
            Some(data) => bus.client.write(entry, data),
            None => bus.client.read(entry),
        };
        bus.run(first).unwrap_err().to_string()
    };
    let no_object = "refused: there is no such object (abort 0602 0000h)";
    assert_eq!(reported(Entry::new(0x3000, 0), None), no_object);
    let no_sub = "refused: there is no such sub-index (abort 0609 0011h)";
    assert_eq!(reported(Entry::new(0x2000, 9), None), no_sub);
    let read_only = "refused: the object can only be read (abort 0601 0002h)";
    assert_eq!(reported(NAME, Some(b"y")), read_only);
    assert_eq!(reported(NAME, Some(b"a longer name")), read_only);
    let length = "refused: the data does not have the length of the object (abort 0607 0010h)";
    assert_eq!(reported(SHORT, Some(&[1, 2])), length);
    assert_eq!(reported(SHORT, Some(&[1, 2, 3, 4, 5])), length);
}
