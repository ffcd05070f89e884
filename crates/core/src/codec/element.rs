//! Values of OPC UA nodes that are not a plain number: elements of arrays, and texts that contain a number.

use std::fmt;

/// Largest number of dimensions of an array.
const MOST_DIMENSIONS: usize = 8;
/// Maximum length of a text that is parsed as a number, in bytes.
const LONGEST_NUMBER: usize = 64;

/// Element of an array: one index for each dimension, from 0.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Element(Vec<u32>);

impl Element {
    /// Creates the element with these indices. Returns `None` without an index, and for more than eight indices.
    pub fn new(indices: Vec<u32>) -> Option<Element> {
        (1..=MOST_DIMENSIONS).contains(&indices.len()).then_some(Element(indices))
    }

    /// Returns the indices, one for each dimension.
    pub fn indices(&self) -> &[u32] {
        &self.0
    }

    /// Returns the index of the element in the flat list of the array's values, in row-major order. `values`:
    /// number of values in the array. `dimensions`: length of each dimension; `None` or empty for an array
    /// with one dimension. `None` is returned if the array does not have the element.
    pub fn place(&self, values: usize, dimensions: Option<&[u32]>) -> Option<usize> {
        let place = match dimensions.filter(|dimensions| !dimensions.is_empty()) {
            None => match self.0.as_slice() {
                [index] => usize::try_from(*index).ok()?,
                _ => return None,
            },
            Some(dimensions) if dimensions.len() == self.0.len() => {
                let mut place = 0usize;
                for (index, length) in self.0.iter().zip(dimensions) {
                    if index >= length {
                        return None;
                    }
                    let (index, length) = (usize::try_from(*index).ok()?, usize::try_from(*length).ok()?);
                    place = place.checked_mul(length)?.checked_add(index)?;
                }
                place
            }
            Some(_) => return None,
        };
        (place < values).then_some(place)
    }
}

/// Formats the element, for example as `element 3` or `element 1, 2`.
impl fmt::Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let indices: Vec<String> = self.0.iter().map(u32::to_string).collect();
        write!(f, "element {}", indices.join(", "))
    }
}

/// Parses a text that is a decimal number, for example `-23.5` or `2.35e1`. Blanks before and after the
/// number are allowed. Returns `None` for any other text, also for a text with a decimal comma or a unit.
pub fn number_in(text: &str) -> Option<f64> {
    let text = text.trim_matches([' ', '\t', '\r', '\n']);
    let is_part = |byte: u8| byte.is_ascii_digit() || matches!(byte, b'+' | b'-' | b'.' | b'e' | b'E');
    if text.len() > LONGEST_NUMBER || !text.bytes().all(is_part) {
        return None;
    }
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn element(indices: &[u32]) -> Element {
        Element::new(indices.to_vec()).unwrap()
    }

    #[test]
    fn an_element_is_found_by_one_index_for_each_dimension() {
        let matrix = Some([2, 3].as_slice());
        for (indices, values, dimensions, place) in [
            ([0].as_slice(), 3, None, Some(0)),
            (&[2], 3, None, Some(2)),
            (&[3], 3, None, None),
            (&[0], 0, None, None),
            (&[u32::MAX], 3, None, None),
            (&[2], 3, Some([3].as_slice()), Some(2)),
            (&[2], 3, Some([].as_slice()), Some(2)),
            (&[0, 2], 6, matrix, Some(2)),
            (&[1, 0], 6, matrix, Some(3)),
            (&[1, 2], 6, matrix, Some(5)),
            // The server sends fewer values than its dimensions state.
            (&[1, 2], 5, matrix, None),
            (&[2, 0], 6, matrix, None),
            (&[0, 3], 6, matrix, None),
            // A matrix has no element with one index, and a list none with two.
            (&[1], 6, matrix, None),
            (&[0, 1], 3, None, None),
        ] {
            assert_eq!(element(indices).place(values, dimensions), place, "{indices:?} of {dimensions:?}");
        }
        assert!(Element::new(Vec::new()).is_none() && Element::new(vec![0; 9]).is_none());
        assert_eq!(
            (element(&[3]).to_string(), element(&[1, 2]).to_string()),
            ("element 3".to_owned(), "element 1, 2".to_owned())
        );
    }

    #[test]
    fn a_text_is_a_number_only_if_all_of_it_is_one() {
        for (text, number) in [
            ("23.5", Some(23.5)),
            (" -23.5\r\n", Some(-23.5)),
            ("+7", Some(7.0)),
            ("2.35e1", Some(23.5)),
            (".5", Some(0.5)),
            ("", None),
            (" ", None),
            ("-", None),
            ("e", None),
            ("23,5", None),
            ("1,234.5", None),
            ("23.5 °C", None),
            ("2 3", None),
            ("0x17", None),
            ("nan", None),
            ("inf", None),
            ("1e999", None),
            ("1_000", None),
            ("ON", None),
        ] {
            assert_eq!(number_in(text), number, "`{text}`");
        }
        assert_eq!(number_in(&"1".repeat(65)), None);
    }

    proptest! {
        #[test]
        fn a_number_is_found_in_its_text(number in -1e9f64..1e9) {
            prop_assert_eq!(number_in(&format!(" {number} ")), Some(number));
        }

        #[test]
        fn any_text_is_a_finite_number_or_none(text in ".*") {
            prop_assert!(number_in(&text).is_none_or(f64::is_finite));
        }

        #[test]
        fn the_place_of_an_element_is_within_the_array(
            indices in prop::collection::vec(any::<u32>(), 1..4),
            dimensions in prop::option::of(prop::collection::vec(any::<u32>(), 0..4)),
            values in 0usize..1000,
        ) {
            let place = element(&indices).place(values, dimensions.as_deref());
            prop_assert!(place.is_none_or(|place| place < values));
        }
    }
}
