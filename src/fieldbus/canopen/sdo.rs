//! The SDO client: one entry of a node's object dictionary read or written, a frame at a time.
//!
//! The caller sends the frames that come out, gives the frames of [`Client::answers`] in, and says when an answer has
//! not come in time. Nothing in an SDO tells one transfer from another but index and sub-index, and its segments do not
//! tell even those. So a frame that cannot be the awaited answer is left alone, and after a transfer that ended without
//! its last answer the client first asks for the device type (1000:00): a node answers in order, so with that answer
//! nothing of the older transfer is under way any more, and no late answer is taken for the next one's.
//!
//! ```text
//! read    40 index sub ─► ◄─ 43 index sub data                                     at most 4 bytes: expedited
//!         40 index sub ─► ◄─ 41 index sub length · 60 ─► ◄─ 00 … · 70 ─► ◄─ 11 …   longer: in segments of 7
//! written 23 index sub data ─► ◄─ 60 index sub
//!         21 index sub length ─► ◄─ 60 index sub · 00 … ─► ◄─ 20 · 11 … ─► ◄─ 30
//! ```

use super::NodeId;
use super::abort::AbortCode;
use isotherm_core::codec::{CanId, Entry, Frame};

/// The identifiers of requests: this and the node's number.
pub const REQUEST: u16 = 0x600;
/// The identifiers of answers: this and the node's number.
pub const ANSWER: u16 = 0x580;

/// The most bytes that are read: more than any value or name has.
pub const LONGEST: usize = 4096;

/// What is asked for, in turn, after a transfer that ended without its last answer: what CiA 301 has in every node. One
/// question alone would not do: its own late answer would be taken for that to the next one.
const SETTLERS: [Entry; 4] =
    [Entry::new(0x1000, 0), Entry::new(0x1001, 0), Entry::new(0x1018, 0), Entry::new(0x1018, 1)];

/// One node's client. One transfer at a time.
#[derive(Clone, Debug)]
pub struct Client {
    node: NodeId,
    state: State,
    /// An answer to an older transfer may still be under way.
    is_unsettled: bool,
    /// What is begun as soon as that is no longer so.
    postponed: Option<Job>,
    /// The question that is asked next to find out.
    settler: usize,
}

#[derive(Clone, Debug)]
struct Job {
    entry: Entry,
    /// What is written; `None`: it is read.
    data: Option<Vec<u8>>,
}

#[derive(Clone, Debug)]
enum State {
    Idle,
    /// The first request is under way.
    Opening(Job),
    /// Segments come in; the next one has this toggle bit.
    Reading {
        entry: Entry,
        length: Option<usize>,
        bytes: Vec<u8>,
        toggle: bool,
    },
    /// Segments go out; the one under way has this toggle bit, and so many bytes are gone with it.
    Writing {
        entry: Entry,
        bytes: Vec<u8>,
        sent: usize,
        toggle: bool,
    },
}

/// What follows from an answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Send it, and wait for the next answer.
    Send(Frame),
    /// Nothing older is under way any more: with this frame begins what was asked for.
    Begin(Frame),
    /// The entry has been read.
    Read(Data),
    /// The entry has been written.
    Written,
    /// It came to nothing. The frame, where there is one, is to be sent: it ends the transfer at the node too.
    Failed(SdoError, Option<Frame>),
}

/// What an entry reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Data {
    bytes: Vec<u8>,
    is_sized: bool,
}

/// Why a transfer came to nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum SdoError {
    /// The node says no.
    #[error("{0} is refused: {1}")]
    Refused(Entry, AbortCode),
    /// No answer in time.
    #[error("{0}: no answer")]
    TimedOut(Entry),
    /// Segments came in a wrong order.
    #[error("{0}: segments in a wrong order, the toggle bit did not alternate")]
    Toggle(Entry),
    /// The segments are together not what was announced.
    #[error("{entry}: {came} bytes came where {announced} were announced")]
    Announced {
        /// What was read.
        entry: Entry,
        /// By its first answer.
        announced: u32,
        /// In its segments.
        came: u32,
    },
    /// More than [`LONGEST`] bytes.
    #[error("{0} is longer than anything that is read here")]
    TooLong(Entry),
    /// The entry has another width than its type.
    #[error("{entry} has {has} bytes, not {wanted}")]
    Width {
        /// What was read.
        entry: Entry,
        /// The bytes that came.
        has: u32,
        /// The bytes of the type.
        wanted: u32,
    },
}

impl Client {
    /// A client of this node, by its standard identifiers.
    pub fn new(node: NodeId) -> Client {
        Client { node, state: State::Idle, is_unsettled: false, postponed: None, settler: 0 }
    }

    /// The identifier on which its answers come.
    pub fn answers(&self) -> CanId {
        self.node.identifier(ANSWER)
    }

    /// Begins to read an entry. Gives the first frame to be sent. A transfer that is under way is given up.
    pub fn read(&mut self, entry: Entry) -> Frame {
        self.begin(Job { entry, data: None })
    }

    /// Begins to write an entry: its bytes, lowest first. Gives the first frame to be sent. A transfer that is under
    /// way is given up.
    pub fn write(&mut self, entry: Entry, data: &[u8]) -> Frame {
        self.begin(Job { entry, data: Some(data.to_vec()) })
    }

    /// Takes a frame. `None`: it is not the awaited answer, and the wait goes on.
    pub fn take(&mut self, frame: &Frame) -> Option<Progress> {
        if frame.id() != self.answers() {
            return None;
        }
        let answer: [u8; 8] = frame.data().try_into().ok()?;
        match std::mem::replace(&mut self.state, State::Idle) {
            State::Idle => None,
            State::Opening(job) => self.opened(job, answer),
            State::Reading { entry, length, bytes, toggle } => {
                self.segment_came(entry, length, bytes, toggle, answer)
            }
            State::Writing { entry, bytes, sent, toggle } => {
                self.segment_went(entry, bytes, sent, toggle, answer)
            }
        }
    }

    /// The awaited answer has not come in time. Gives why, and what is to be sent, so that the node gives up too;
    /// `None` where nothing is awaited.
    pub fn timed_out(&mut self) -> Option<(SdoError, Frame)> {
        let wanted = self.postponed.take().map(|job| job.entry);
        let asked = self.awaited()?;
        self.state = State::Idle;
        self.is_unsettled = true;
        Some((SdoError::TimedOut(wanted.unwrap_or(asked)), self.abort(asked, AbortCode::TIMED_OUT)))
    }

    /// An answer of the node has come that answers nothing: more of them may be under way.
    pub fn was_not_asked(&mut self, frame: &Frame) {
        self.is_unsettled |= frame.id() == self.answers();
    }

    fn awaited(&self) -> Option<Entry> {
        match &self.state {
            State::Idle => None,
            State::Opening(job) => Some(job.entry),
            State::Reading { entry, .. } | State::Writing { entry, .. } => Some(*entry),
        }
    }

    fn begin(&mut self, job: Job) -> Frame {
        if self.is_unsettled || self.awaited().is_some() {
            self.is_unsettled = true;
            self.postponed = Some(job);
            let entry = SETTLERS[self.settler];
            self.settler = (self.settler + 1) % SETTLERS.len();
            self.open(Job { entry, data: None })
        } else {
            self.open(job)
        }
    }

    fn open(&mut self, job: Job) -> Frame {
        let (command, rest) = match &job.data {
            None => (0x40, [0; 4]),
            Some(data) => match data.as_slice() {
                &[a] => (0x2f, [a, 0, 0, 0]),
                &[a, b] => (0x2b, [a, b, 0, 0]),
                &[a, b, c] => (0x27, [a, b, c, 0]),
                &[a, b, c, d] => (0x23, [a, b, c, d]),
                longer => (0x21, count(longer.len()).to_le_bytes()),
            },
        };
        let frame = self.request(command, job.entry, rest);
        self.state = State::Opening(job);
        frame
    }

    /// The answer to the first request.
    fn opened(&mut self, job: Job, answer: [u8; 8]) -> Option<Progress> {
        let [command, low, high, sub, rest @ ..] = answer;
        let entry = job.entry;
        let is_ours = Entry::new(u16::from_le_bytes([low, high]), sub) == entry;
        match (command >> 5, job.data) {
            (4, _) if is_ours => self.refused(entry, rest),
            (2, None) if is_ours => {
                let is_sized = command & 1 == 1;
                if command & 2 == 2 {
                    let empty = if is_sized { usize::from(command >> 2 & 3) } else { 0 };
                    return self.has_read(Data { bytes: rest[..4 - empty].to_vec(), is_sized });
                }
                let length = is_sized.then(|| u32::from_le_bytes(rest));
                let length = length.map(|length| usize::try_from(length).unwrap_or(usize::MAX));
                if length.is_some_and(|length| length > LONGEST) {
                    return self.fail(SdoError::TooLong(entry), AbortCode::MEMORY);
                }
                self.state = State::Reading { entry, length, bytes: Vec::new(), toggle: false };
                Some(Progress::Send(self.request_segment(false)))
            }
            (3, Some(data)) if is_ours && !(1..=4).contains(&data.len()) => {
                Some(Progress::Send(self.send_segment(entry, data, 0, false)))
            }
            (3, Some(_)) if is_ours => Some(Progress::Written),
            (_, data) => {
                self.state = State::Opening(Job { entry, data });
                None
            }
        }
    }

    /// The answer to the request for a segment.
    fn segment_came(
        &mut self,
        entry: Entry,
        length: Option<usize>,
        mut bytes: Vec<u8>,
        toggle: bool,
        answer: [u8; 8],
    ) -> Option<Progress> {
        let [command, low, high, sub, rest @ ..] = answer;
        if command >> 5 == 4 && Entry::new(u16::from_le_bytes([low, high]), sub) == entry {
            return self.refused(entry, rest);
        }
        if command >> 5 != 0 {
            self.state = State::Reading { entry, length, bytes, toggle };
            return None;
        }
        if (command & 0x10 != 0) != toggle {
            return self.fail(SdoError::Toggle(entry), AbortCode::TOGGLE);
        }
        let empty = usize::from(command >> 1 & 7);
        bytes.extend_from_slice(&answer[1..8 - empty]);
        let is_last = command & 1 == 1;
        match length {
            Some(announced) if bytes.len() > announced || (is_last && bytes.len() < announced) => {
                let (announced, came) = (count(announced), count(bytes.len()));
                self.fail(SdoError::Announced { entry, announced, came }, AbortCode::LENGTH)
            }
            _ if bytes.len() > LONGEST => self.fail(SdoError::TooLong(entry), AbortCode::MEMORY),
            _ if is_last => self.has_read(Data { bytes, is_sized: true }),
            _ => {
                self.state = State::Reading { entry, length, bytes, toggle: !toggle };
                Some(Progress::Send(self.request_segment(!toggle)))
            }
        }
    }

    /// The answer to a segment.
    fn segment_went(
        &mut self,
        entry: Entry,
        bytes: Vec<u8>,
        sent: usize,
        toggle: bool,
        answer: [u8; 8],
    ) -> Option<Progress> {
        let [command, low, high, sub, rest @ ..] = answer;
        match command >> 5 {
            4 if Entry::new(u16::from_le_bytes([low, high]), sub) == entry => self.refused(entry, rest),
            1 if (command & 0x10 != 0) != toggle => self.fail(SdoError::Toggle(entry), AbortCode::TOGGLE),
            1 if sent >= bytes.len() => Some(Progress::Written),
            1 => Some(Progress::Send(self.send_segment(entry, bytes, sent, !toggle))),
            _ => {
                self.state = State::Writing { entry, bytes, sent, toggle };
                None
            }
        }
    }

    fn has_read(&mut self, data: Data) -> Option<Progress> {
        Some(self.settled().map_or(Progress::Read(data), Progress::Begin))
    }

    /// A refusal is the last answer of its transfer.
    fn refused(&mut self, entry: Entry, code: [u8; 4]) -> Option<Progress> {
        let code = AbortCode(u32::from_le_bytes(code));
        let failed = Progress::Failed(SdoError::Refused(entry, code), None);
        Some(self.settled().map_or(failed, Progress::Begin))
    }

    /// Where the last answer was that of the settling question, whatever it said: begins what has waited for it.
    fn settled(&mut self) -> Option<Frame> {
        let job = self.postponed.take()?;
        self.is_unsettled = false;
        Some(self.open(job))
    }

    fn fail(&mut self, error: SdoError, code: AbortCode) -> Option<Progress> {
        let entry = error.entry();
        self.is_unsettled = true;
        self.postponed = None;
        Some(Progress::Failed(error, Some(self.abort(entry, code))))
    }

    fn send_segment(&mut self, entry: Entry, bytes: Vec<u8>, from: usize, toggle: bool) -> Frame {
        let until = bytes.len().min(from + 7);
        let part = &bytes[from..until];
        let empty = u8::try_from(7 - part.len()).unwrap_or(0);
        let mut data = [0; 8];
        data[0] = u8::from(toggle) << 4 | empty << 1 | u8::from(until == bytes.len());
        data[1..=part.len()].copy_from_slice(part);
        self.state = State::Writing { entry, bytes, sent: until, toggle };
        self.frame(data)
    }

    fn request_segment(&self, toggle: bool) -> Frame {
        self.frame([0x60 | u8::from(toggle) << 4, 0, 0, 0, 0, 0, 0, 0])
    }

    fn abort(&self, entry: Entry, code: AbortCode) -> Frame {
        self.request(0x80, entry, code.0.to_le_bytes())
    }

    fn request(&self, command: u8, entry: Entry, rest: [u8; 4]) -> Frame {
        let [low, high] = entry.index.to_le_bytes();
        let [a, b, c, d] = rest;
        self.frame([command, low, high, entry.sub, a, b, c, d])
    }

    fn frame(&self, data: [u8; 8]) -> Frame {
        Frame::short(self.node.identifier(REQUEST), data)
    }
}

impl Data {
    /// As they came, lowest first. Four of which some may mean nothing, where the node did not say how many are meant.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The bytes of a type of this width.
    ///
    /// # Errors
    /// The entry has another width.
    pub fn of_width(&self, width: usize, entry: Entry) -> Result<&[u8], SdoError> {
        let bytes =
            if self.is_sized { self.bytes.as_slice() } else { self.bytes.get(..width).unwrap_or_default() };
        if bytes.len() == width {
            Ok(bytes)
        } else {
            Err(SdoError::Width { entry, has: count(self.bytes.len()), wanted: count(width) })
        }
    }
}

impl SdoError {
    /// What was to be read or written.
    pub const fn entry(self) -> Entry {
        match self {
            SdoError::Refused(entry, _)
            | SdoError::TimedOut(entry)
            | SdoError::Toggle(entry)
            | SdoError::TooLong(entry)
            | SdoError::Announced { entry, .. }
            | SdoError::Width { entry, .. } => entry,
        }
    }
}

fn count(bytes: usize) -> u32 {
    u32::try_from(bytes).unwrap_or(u32::MAX)
}
