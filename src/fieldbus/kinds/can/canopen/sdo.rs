//! SDO client: reads or writes one entry of a node's object dictionary, frame by frame.
//!
//! The caller sends the returned frames, passes in the frames with the identifier [`Client::answers`], and
//! reports a timeout.
//!
//! Only index and sub-index show to which SDO transfer a frame belongs, and a segment contains neither. The
//! client therefore ignores a frame that cannot be the expected answer. After a transfer that ended without
//! its last answer, the client first reads an entry that every node has. A node answers in order. When the
//! answer to this read arrives, no answer to an older transfer can follow. No old answer can then be mistaken
//! for the answer to the next transfer.
//!
//! ```text
//! read    40 index sub ─► ◄─ 43 index sub data                                     at most 4 bytes: expedited
//!         40 index sub ─► ◄─ 41 index sub length · 60 ─► ◄─ 00 … · 70 ─► ◄─ 11 …   longer: in segments of 7
//! written 23 index sub data ─► ◄─ 60 index sub
//!         21 index sub length ─► ◄─ 60 index sub · 00 … ─► ◄─ 20 · 11 … ─► ◄─ 30
//! ```

use super::NodeId;
use super::abort::AbortCode;
use crate::fieldbus::error::{Fault, PeerFault};
use isotherm_core::codec::{CanId, Entry, Frame};

/// First CAN identifier of SDO requests, to which the number of the node is added.
pub const REQUEST: u16 = 0x600;
/// First CAN identifier of SDO answers, to which the number of the node is added.
pub const ANSWER: u16 = 0x580;

/// Returns the CAN identifiers of the SDO transfers with a node: requests and answers.
pub fn identifiers(node: NodeId) -> [CanId; 2] {
    [node.identifier(REQUEST), node.identifier(ANSWER)]
}

/// Maximum length in bytes of an entry that the client reads. All values and names of CANopen devices are shorter.
pub const LONGEST: usize = 4096;

/// Entries that the client reads after a transfer whose last answer is missing: one entry per such transfer, in
/// rotation. CiA 301 requires them in every node. A single entry is not enough: a late answer to the first read of the
/// entry would be mistaken for the answer to its second read.
const SETTLERS: [Entry; 4] =
    [Entry::new(0x1000, 0), Entry::new(0x1001, 0), Entry::new(0x1018, 0), Entry::new(0x1018, 1)];

/// SDO client of one node, for one transfer at a time.
#[derive(Clone, Debug)]
pub struct Client {
    node: NodeId,
    /// Transfer in progress; `None` between transfers.
    transfer: Option<Transfer>,
    /// Whether an answer to an older transfer may still arrive. The client then first reads an entry of `SETTLERS`.
    is_unsettled: bool,
    /// Requested transfer that begins when no answer to an older transfer can arrive any more.
    postponed: Option<Job>,
    /// Index in [`SETTLERS`] of the entry that is read next.
    settler: usize,
}

#[derive(Clone, Debug)]
struct Job {
    entry: Entry,
    /// Bytes to write; `None` for a read.
    data: Option<Vec<u8>>,
}

#[derive(Clone, Debug)]
struct Transfer {
    job: Job,
    stage: Stage,
}

#[derive(Clone, Debug)]
enum Stage {
    /// The first request was sent, and its answer is expected.
    Opening,
    /// The node sends segments; the next segment has this toggle bit.
    Reading { length: Option<usize>, bytes: Vec<u8>, toggle: bool },
    /// The client sends segments. The last segment sent has this toggle bit. `sent` counts all bytes sent, including
    /// the bytes of this segment.
    Writing { sent: usize, toggle: bool },
}

/// Effect of a received answer on the SDO transfer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Frame that the caller sends next; the transfer continues.
    Send(Frame),
    /// First frame of the transfer that the caller requested. No answer to an older transfer can arrive now.
    Begin(Frame),
    /// The entry was read.
    Read(Data),
    /// The entry was written.
    Written,
    /// The transfer failed with this fault. If there is a frame, the caller sends it to abort the transfer at the node.
    Failed(Fault, Option<Frame>),
}

/// Bytes that were read from an entry of the object dictionary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Data {
    bytes: Vec<u8>,
    is_sized: bool,
}

impl Client {
    /// Returns a client of this node with the identifiers 0x600 and 0x580 plus the node number.
    pub fn new(node: NodeId) -> Client {
        Client { node, transfer: None, is_unsettled: false, postponed: None, settler: 0 }
    }

    /// Returns the CAN identifier with which the node sends its answers.
    pub fn answers(&self) -> CanId {
        self.node.identifier(ANSWER)
    }

    /// Begins to read an entry, and returns the first frame to send. A transfer in progress is abandoned.
    pub fn read(&mut self, entry: Entry) -> Frame {
        self.begin(Job { entry, data: None })
    }

    /// Begins to write an entry, and returns the first frame to send. `data` has the lowest byte first. A transfer in
    /// progress is abandoned.
    pub fn write(&mut self, entry: Entry, data: &[u8]) -> Frame {
        self.begin(Job { entry, data: Some(data.to_vec()) })
    }

    /// Processes a frame. Returns `None` if the frame is not the expected answer; the client then continues to wait.
    pub fn take(&mut self, frame: &Frame) -> Option<Progress> {
        if frame.id() != self.answers() {
            return None;
        }
        let answer: [u8; 8] = frame.data().try_into().ok()?;
        let [command, low, high, sub, rest @ ..] = answer;
        let Transfer { job, stage } = self.transfer.as_mut()?;
        let is_ours = Entry::new(u16::from_le_bytes([low, high]), sub) == job.entry;
        let toggled = command & 0x10 != 0;
        match (command >> 5, stage, &job.data) {
            // An abort is the last answer of its transfer.
            (4, ..) if is_ours => {
                let refused = Fault::Aborted(AbortCode(u32::from_le_bytes(rest)));
                Some(self.ended(Progress::Failed(refused, None)))
            }
            (2, Stage::Opening, None) if is_ours => Some(self.read_opened(command, rest)),
            (3, Stage::Opening, Some(data)) if is_ours && (1..=4).contains(&data.len()) => {
                Some(self.ended(Progress::Written))
            }
            (3, stage @ Stage::Opening, Some(data)) if is_ours => {
                let (segment, sent) = segment(data, 0, false);
                *stage = Stage::Writing { sent, toggle: false };
                Some(Progress::Send(self.frame(segment)))
            }
            (0, Stage::Reading { toggle, .. }, _) | (1, Stage::Writing { toggle, .. }, _)
                if toggled != *toggle =>
            {
                Some(self.fail(AbortCode::TOGGLE))
            }
            (0, Stage::Reading { length, bytes, toggle }, _) => {
                bytes.extend_from_slice(&answer[1..8 - usize::from(command >> 1 & 7)]);
                let is_last = command & 1 == 1;
                Some(match *length {
                    Some(length) if bytes.len() > length || (is_last && bytes.len() < length) => {
                        self.fail(AbortCode::LENGTH)
                    }
                    _ if bytes.len() > LONGEST => self.fail(AbortCode::MEMORY),
                    _ if is_last => {
                        let bytes = std::mem::take(bytes);
                        self.ended(Progress::Read(Data { bytes, is_sized: true }))
                    }
                    _ => {
                        *toggle = !*toggle;
                        let next = 0x60 | u8::from(*toggle) << 4;
                        Progress::Send(self.frame([next, 0, 0, 0, 0, 0, 0, 0]))
                    }
                })
            }
            (1, Stage::Writing { sent, .. }, Some(data)) if *sent >= data.len() => {
                Some(self.ended(Progress::Written))
            }
            (1, Stage::Writing { sent, toggle }, Some(data)) => {
                *toggle = !*toggle;
                let (segment, until) = segment(data, *sent, *toggle);
                *sent = until;
                Some(Progress::Send(self.frame(segment)))
            }
            _ => None,
        }
    }

    /// Records that the expected answer did not arrive in time. Returns the abort to send to the node; `None` if no
    /// answer was expected.
    pub fn timed_out(&mut self) -> Option<Frame> {
        self.postponed = None;
        let transfer = self.transfer.take()?;
        self.is_unsettled = true;
        Some(self.abort(transfer.job.entry, AbortCode::TIMED_OUT))
    }

    /// Records a received frame that answers no request. If the frame is an answer of the node, more such answers may
    /// follow. The client then reads another entry before its next transfer, to detect that no more answers follow.
    pub fn was_not_asked(&mut self, frame: &Frame) {
        self.is_unsettled |= frame.id() == self.answers();
    }

    fn begin(&mut self, job: Job) -> Frame {
        if !self.is_unsettled && self.transfer.is_none() {
            return self.open(job);
        }
        self.is_unsettled = true;
        self.postponed = Some(job);
        let entry = SETTLERS[self.settler];
        self.settler = (self.settler + 1) % SETTLERS.len();
        self.open(Job { entry, data: None })
    }

    fn open(&mut self, job: Job) -> Frame {
        let (command, rest) = match job.data.as_deref() {
            None => (0x40, [0; 4]),
            Some(&[a]) => (0x2f, [a, 0, 0, 0]),
            Some(&[a, b]) => (0x2b, [a, b, 0, 0]),
            Some(&[a, b, c]) => (0x27, [a, b, c, 0]),
            Some(&[a, b, c, d]) => (0x23, [a, b, c, d]),
            Some(longer) => (0x21, u32::try_from(longer.len()).unwrap_or(u32::MAX).to_le_bytes()),
        };
        let frame = self.request(command, job.entry, rest);
        self.transfer = Some(Transfer { job, stage: Stage::Opening });
        frame
    }

    /// Processes the first answer of a read: the whole entry, or the start of its segments.
    fn read_opened(&mut self, command: u8, rest: [u8; 4]) -> Progress {
        let is_sized = command & 1 == 1;
        if command & 2 == 2 {
            let empty = if is_sized { usize::from(command >> 2 & 3) } else { 0 };
            return self.ended(Progress::Read(Data { bytes: rest[..4 - empty].to_vec(), is_sized }));
        }
        let length = is_sized.then(|| usize::try_from(u32::from_le_bytes(rest)).unwrap_or(usize::MAX));
        if length.is_some_and(|length| length > LONGEST) {
            return self.fail(AbortCode::MEMORY);
        }
        if let Some(transfer) = &mut self.transfer {
            transfer.stage = Stage::Reading { length, bytes: Vec::new(), toggle: false };
        }
        Progress::Send(self.frame([0x60, 0, 0, 0, 0, 0, 0, 0]))
    }

    /// Ends a transfer with its last answer. If a transfer was postponed, this transfer begins now: the answer shows
    /// that no older answer can follow.
    fn ended(&mut self, progress: Progress) -> Progress {
        self.transfer = None;
        let Some(job) = self.postponed.take() else { return progress };
        self.is_unsettled = false;
        Progress::Begin(self.open(job))
    }

    /// Abandons the transfer because the answer violates the protocol. Returns the frame that aborts the transfer at
    /// the node.
    fn fail(&mut self, code: AbortCode) -> Progress {
        let entry = self.transfer.take().map(|transfer| transfer.job.entry);
        self.is_unsettled = true;
        self.postponed = None;
        Progress::Failed(Fault::Peer(PeerFault::Malformed), entry.map(|entry| self.abort(entry, code)))
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
    /// Returns the received bytes, the lowest first. If the node did not report the length, the result has four bytes,
    /// and the higher bytes may have no meaning.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Returns the received bytes as a value that is `width` bytes long.
    ///
    /// # Errors
    /// The node reported another width for the entry.
    pub fn of_width(&self, width: usize) -> Result<&[u8], Fault> {
        let bytes =
            if self.is_sized { self.bytes.as_slice() } else { self.bytes.get(..width).unwrap_or_default() };
        if bytes.len() == width { Ok(bytes) } else { Err(Fault::Peer(PeerFault::Width)) }
    }
}

/// Returns the frame with the segment that begins at index `from` of `data`, and the index at which the next segment
/// begins.
fn segment(data: &[u8], from: usize, toggle: bool) -> ([u8; 8], usize) {
    let until = data.len().min(from + 7);
    let part = &data[from..until];
    let empty = u8::try_from(7 - part.len()).unwrap_or(0);
    let mut segment = [0; 8];
    segment[0] = u8::from(toggle) << 4 | empty << 1 | u8::from(until == data.len());
    segment[1..=part.len()].copy_from_slice(part);
    (segment, until)
}
