//! Content of the CAN frames that the gateway writes. Several values may share a frame, and the gateway always sends
//! the whole frame. The gateway must therefore know the other values of a frame before it sends the frame.

use crate::fieldbus::error::{CallerFault, Fault};
use isotherm_core::codec::{BitField, CanId, Encoded, Frame, Object};

/// CAN frames that the gateway writes on one interface, with their current content.
#[derive(Clone, Debug, Default)]
pub struct Images(Vec<Image>);

#[derive(Clone, Debug)]
struct Image {
    frame: Frame,
    values: Vec<Value>,
}

/// Position of one value in a frame, and the source of its current content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Value {
    /// Bits of the value in the frame.
    pub bits: BitField,
    /// Node and object from which the current value can be read; `None` if no object contains the value.
    pub read_at: Option<(u8, Object)>,
    /// Whether the frame contains the value: the gateway has written it, or has read it from `read_at`.
    is_known: bool,
}

impl Value {
    /// Returns the entry for a value whose current content is not known yet.
    pub fn new(bits: BitField, read_at: Option<(u8, Object)>) -> Value {
        Value { bits, read_at, is_known: false }
    }
}

impl Images {
    /// Adds a frame with these values. All bits outside of `values` keep the data of `frame`.
    pub fn add(&mut self, frame: Frame, values: Vec<Value>) {
        self.0.push(Image { frame, values });
    }

    /// Puts a value into its CAN frame. Returns the frame to send.
    ///
    /// # Errors
    /// The frame `id` does not exist, or another value of the frame is not known yet. Sending zero for that other value
    /// would write a wrong value.
    pub fn put(&mut self, id: CanId, bits: BitField, registers: &[u16]) -> Result<Frame, Fault> {
        let image = self.0.iter_mut().find(|image| image.frame.id() == id);
        let image = image.ok_or(Fault::Caller(CallerFault::Extent))?;
        image.put(bits, Encoded::of(registers).bits())?;
        let is_whole = image.values.iter().all(|value| value.is_known);
        if is_whole { Ok(image.frame) } else { Err(Fault::Caller(CallerFault::Incomplete)) }
    }

    /// Records the value of an object that was read from a node. The value is put into its CAN frame only if the frame
    /// does not contain this value yet.
    pub fn was_read(&mut self, node: u8, object: Object, registers: &[u16]) {
        for image in &mut self.0 {
            let read = |value: &&Value| !value.is_known && value.read_at == Some((node, object));
            if let Some(bits) = image.values.iter().find(read).map(|value| value.bits) {
                // If the value does not fit, it stays unknown.
                let _ = image.put(bits, Encoded::of(registers).bits());
            }
        }
    }
}

impl Image {
    fn put(&mut self, bits: BitField, value: u64) -> Result<(), Fault> {
        bits.insert(self.frame.data_mut(), value).map_err(|_| Fault::Caller(CallerFault::Extent))?;
        self.values.iter_mut().filter(|known| known.bits == bits).for_each(|known| known.is_known = true);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::{BitKind, ByteOrder, DataType};

    fn bits(start: u16) -> BitField {
        BitField::new(start, 16, ByteOrder::Intel, BitKind::Signed).unwrap()
    }

    #[test]
    fn a_frame_is_sent_when_each_of_its_values_is_known_and_keeps_what_nobody_writes() {
        let id = CanId::standard(0x20c).unwrap();
        let object = Object::new(0x2001, 0, DataType::I16);
        let mut images = Images::default();
        let frame = Frame::classic(id, &[0xaa, 0, 0, 0, 0, 0xbb]).unwrap();
        images.add(frame, vec![Value::new(bits(8), None), Value::new(bits(24), Some((5, object)))]);
        let incomplete = Err(Fault::Caller(CallerFault::Incomplete));
        assert_eq!(images.put(id, bits(8), &[0x0102]), incomplete);
        images.was_read(6, object, &[9]);
        assert_eq!(images.put(id, bits(8), &[0x0102]), incomplete);
        images.was_read(5, object, &[0xfffe]);
        let whole = images.put(id, bits(8), &[0x0103]).unwrap();
        assert_eq!(whole.data(), [0xaa, 0x03, 0x01, 0xfe, 0xff, 0xbb]);
        // An earlier reading does not overwrite a known value.
        images.was_read(5, object, &[7]);
        assert_eq!(images.put(id, bits(8), &[1]).unwrap().data(), [0xaa, 1, 0, 0xfe, 0xff, 0xbb]);
        let other = CanId::standard(0x20d).unwrap();
        assert_eq!(images.put(other, bits(8), &[1]), Err(Fault::Caller(CallerFault::Extent)));
    }
}
