//! List of fixed capacity. A step therefore needs no memory allocation.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::quantity::{Shift, Shifted};

/// List of at most `N` items, in the order of insertion.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(
    into = "Vec<T>",
    try_from = "Vec<T>",
    bound(serialize = "T: Copy + Serialize", deserialize = "T: Copy + Deserialize<'de>")
)]
pub struct Slots<T, const N: usize> {
    items: [Option<T>; N],
    len: usize,
}

impl<T: Copy, const N: usize> Slots<T, N> {
    /// Returns the number of items in the list.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns whether the list is empty.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Appends an item. Returns false if the list was full; the item is then not appended.
    #[must_use]
    pub fn push(&mut self, item: T) -> bool {
        let slot = self.items.get_mut(self.len);
        let has_room = slot.is_some();
        if let Some(slot) = slot {
            *slot = Some(item);
            self.len += 1;
        }
        has_room
    }

    /// Iterates over the items, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.items.iter().flatten()
    }

    pub(super) fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.items.iter_mut().flatten()
    }

    pub(super) fn retain(&mut self, mut stays: impl FnMut(&T) -> bool) {
        let before = std::mem::take(self);
        for item in before.iter().filter(|item| stays(item)) {
            let _ = self.push(*item);
        }
    }
}

impl<T: Shifted, const N: usize> Shifted for Slots<T, N> {
    fn shift(&mut self, by: Shift) {
        self.items.iter_mut().flatten().for_each(|item| item.shift(by));
    }
}

impl<T: Copy, const N: usize> Default for Slots<T, N> {
    fn default() -> Self {
        Slots { items: [None; N], len: 0 }
    }
}

impl<T: Copy, const N: usize> From<Slots<T, N>> for Vec<T> {
    fn from(slots: Slots<T, N>) -> Vec<T> {
        slots.iter().copied().collect()
    }
}

impl<T: Copy, const N: usize> TryFrom<Vec<T>> for Slots<T, N> {
    type Error = &'static str;
    fn try_from(items: Vec<T>) -> Result<Self, Self::Error> {
        let mut slots = Slots::default();
        if items.into_iter().all(|item| slots.push(item)) {
            Ok(slots)
        } else {
            Err("the list has more items than it can hold")
        }
    }
}

impl<T: Copy + fmt::Debug, const N: usize> fmt::Debug for Slots<T, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}
