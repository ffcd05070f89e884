//! Tensors of an ONNX file whose numbers are in other files next to it (external data).

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path};

use super::encode::put_bytes;
use super::frame::{Field, Fields, last_text, parts, raw_fields};

/// Contents of the files next to an ONNX file that contain numbers of its tensors, by the names in the ONNX file.
pub type ExternalFiles = BTreeMap<String, Vec<u8>>;

/// Maximum number of files next to an ONNX file.
const MOST_FILES: usize = 64;

/// Location of the numbers of one tensor: the file, and the bytes in it.
struct Place<'a> {
    tensor: &'a str,
    /// Name of the file as [`inside`] returns it.
    file: String,
    offset: u64,
    /// Number of bytes; `None` for all bytes up to the end of the file.
    length: Option<u64>,
}

/// Returns the names of the files that contain numbers of tensors, relative to the directory of the ONNX file.
///
/// # Errors
/// Returns a message if a name leads out of this directory, or if there are too many files.
pub(super) fn files(bytes: &[u8]) -> Result<BTreeSet<String>, String> {
    let graphs = || parts(bytes, 7);
    let nodes = graphs().flat_map(|graph| parts(graph, 1));
    let attributes = nodes.flat_map(|node| parts(node, 5)).flat_map(|attribute| parts(attribute, 5));
    let mut files = BTreeSet::new();
    for tensor in graphs().flat_map(|graph| parts(graph, 5)).chain(attributes) {
        if is_external(tensor) {
            files.insert(place(tensor)?.file);
        }
    }
    if files.len() > MOST_FILES {
        return Err(format!(
            "the tensors of the network are in {} other files; at most {MOST_FILES} are allowed: {ONE_FILE}",
            files.len()
        ));
    }
    Ok(files)
}

const ONE_FILE: &str =
    "save the network in one file, in Python by `onnx.save_model(onnx.load(\"net.onnx\"), \"one.onnx\")`";

/// Files with tensors, and the number of bytes that the tensors may still use. Without this limit, many tensors could
/// use the same bytes, and a small file would need much memory.
pub(super) struct External<'a> {
    files: &'a ExternalFiles,
    left: u64,
}

impl<'a> External<'a> {
    pub(super) fn new(files: &'a ExternalFiles) -> External<'a> {
        External { files, left: files.values().fold(0, |all, file| all.saturating_add(file.len() as u64)) }
    }

    /// Returns the tensor with its numbers copied from the other file. A tensor without external data is returned
    /// unchanged.
    ///
    /// # Errors
    /// Returns a message if the numbers are missing.
    pub(super) fn inlined(&mut self, tensor: &[u8]) -> Result<Vec<u8>, String> {
        if !is_external(tensor) {
            return Ok(tensor.to_vec());
        }
        let place = place(tensor)?;
        let (name, file) = (place.tensor, place.file.as_str());
        let Some(bytes) = self.files.get(file) else {
            return Err(format!(
                "tensor `{name}` is in the file {file}, which was not found: copy this file to the directory \
                 of the ONNX file, or {ONE_FILE}"
            ));
        };
        let Some(numbers) = place.slice(bytes) else {
            return Err(format!(
                "tensor `{name}` is beyond the end of {file}, which has {} bytes: the file is incomplete, or belongs \
                 to another export. Export the network again",
                bytes.len()
            ));
        };
        let Some(left) = self.left.checked_sub(numbers.len() as u64) else {
            return Err(format!(
                "tensor `{name}` uses bytes of {file} that another tensor uses too: export the network again"
            ));
        };
        self.left = left;
        let mut inlined = Vec::with_capacity(tensor.len() + numbers.len());
        let kept = raw_fields(tensor).filter(|(field, ..)| !matches!(field, 9 | 13 | 14));
        kept.for_each(|(.., raw)| inlined.extend_from_slice(raw));
        put_bytes(&mut inlined, 9, numbers);
        Ok(inlined)
    }
}

impl Place<'_> {
    fn slice<'f>(&self, file: &'f [u8]) -> Option<&'f [u8]> {
        let rest = file.get(usize::try_from(self.offset).ok()?..)?;
        match self.length {
            Some(length) => rest.get(..usize::try_from(length).ok()?),
            None => Some(rest),
        }
    }
}

/// Returns whether the numbers of a tensor are in another file.
pub(super) fn is_external(tensor: &[u8]) -> bool {
    Fields(tensor).flatten().any(|found| matches!(found, (14, Field::Number(1))))
}

/// Reads the location of a tensor's external numbers.
///
/// # Errors
/// Returns a message if the location is incomplete, or outside the directory of the ONNX file.
fn place(tensor: &[u8]) -> Result<Place<'_>, String> {
    let name = last_text(tensor, 8);
    let entry = |key: &str| {
        let entry = parts(tensor, 13).find(|entry| last_text(entry, 1) == key);
        entry.map(|entry| last_text(entry, 2))
    };
    let number = |key: &str| match entry(key) {
        None => Ok(None),
        Some(text) => text.parse::<u64>().map(Some).map_err(|_| {
            format!("tensor `{name}` has external data with an invalid {key}: export the network again")
        }),
    };
    let location = entry("location").unwrap_or_default();
    let Some(file) = inside(location) else {
        return Err(format!(
            "tensor `{name}` is in the file `{location}`: only files in the directory of the ONNX file or below \
             it are read. To fix it, {ONE_FILE}"
        ));
    };
    Ok(Place { tensor: name, file, offset: number("offset")?.unwrap_or(0), length: number("length")? })
}

/// Returns the name of a file without parts such as `./`, because a file under several names would be read several
/// times. `None` if the name leads out of the directory of the ONNX file.
fn inside(name: &str) -> Option<String> {
    let mut parts = Vec::new();
    for part in Path::new(name).components() {
        match part {
            Component::Normal(part) => parts.push(part.to_str()?),
            Component::CurDir => {}
            _ => return None,
        }
    }
    Some(parts.join("/")).filter(|name| !name.is_empty() && !name.contains('\\'))
}
