//! README and the manual: chapters and fenced blocks.

use std::path::{Path, PathBuf};

/// One text of the manual.
pub(crate) struct Chapter {
    /// Path, for example `docs/can.md`.
    pub(crate) path: PathBuf,
    pub(crate) text: String,
}

/// Text between two fences, with the marks after the first one: ```` ```toml,part ````.
pub(crate) struct Block {
    /// Place, for example `docs/can.md:12`.
    pub(crate) place: String,
    pub(crate) language: String,
    pub(crate) marks: Vec<String>,
    pub(crate) text: String,
}

impl Block {
    pub(crate) fn is(&self, mark: &str) -> bool {
        self.marks.iter().any(|known| known == mark)
    }

    /// Returns whether its commands run in another test, or in none.
    pub(crate) fn is_run_elsewhere(&self) -> bool {
        self.says("by-hand").is_some() || self.says("by").is_some()
    }

    /// Value of a mark after its `=`.
    pub(crate) fn says(&self, mark: &str) -> Option<&str> {
        self.marks.iter().find_map(|known| known.strip_prefix(mark)?.strip_prefix('='))
    }
}

pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

pub(crate) fn read(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// README, and every text below `docs`.
pub(crate) fn chapters() -> Vec<Chapter> {
    let mut paths = vec![PathBuf::from("README.md")];
    gather(Path::new("docs"), &mut paths);
    paths.sort();
    paths.into_iter().map(|path| Chapter { text: read(&path), path }).collect()
}

fn gather(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(root().join(folder)).unwrap() {
        let path = folder.join(entry.unwrap().file_name());
        if root().join(&path).is_dir() {
            gather(&path, found);
        } else if path.extension().is_some_and(|end| end == "md") {
            found.push(path);
        }
    }
}

impl Chapter {
    pub(crate) fn blocks(&self) -> Vec<Block> {
        let mut blocks: Vec<Block> = Vec::new();
        let mut is_open = false;
        for (index, line) in self.text.lines().enumerate() {
            match line.strip_prefix("```") {
                Some(_) if is_open => is_open = false,
                Some(info) => {
                    let mut marks = info.split(',').map(|mark| mark.trim().to_owned());
                    blocks.push(Block {
                        place: format!("{}:{}", self.path.display(), index + 1),
                        language: marks.next().unwrap_or_default(),
                        marks: marks.collect(),
                        text: String::new(),
                    });
                    is_open = true;
                }
                None if is_open => {
                    let text = &mut blocks.last_mut().unwrap().text;
                    text.push_str(line);
                    text.push('\n');
                }
                None => {}
            }
        }
        assert!(!is_open, "{}: the last fence stays open", self.path.display());
        blocks
    }

    /// Text without fenced blocks.
    pub(crate) fn prose(&self) -> String {
        let mut is_open = false;
        let kept = self.text.lines().map(|line| {
            let is_fence = line.starts_with("```");
            is_open ^= is_fence;
            if is_open || is_fence { "" } else { line }
        });
        kept.collect::<Vec<_>>().join("\n")
    }
}
