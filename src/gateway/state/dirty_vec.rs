//! Vector that records which of its items may have changed. The caller can then update only the data that
//! depend on these items.

use std::ops::{Index, IndexMut};

/// Vector that records changes: mutable access to an item marks it as changed.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct DirtyVec<T> {
    items: Vec<T>,
    places: Vec<usize>,
    is_noted: Vec<bool>,
}

impl<T> DirtyVec<T> {
    pub(in crate::gateway) fn new(items: Vec<T>) -> DirtyVec<T> {
        let (places, is_noted) = ((0..items.len()).collect(), vec![true; items.len()]);
        DirtyVec { items, places, is_noted }
    }

    pub(in crate::gateway) fn len(&self) -> usize {
        self.items.len()
    }

    pub(in crate::gateway) fn as_slice(&self) -> &[T] {
        &self.items
    }

    /// Marks all items as changed.
    pub(in crate::gateway) fn note_all(&mut self) {
        (0..self.items.len()).for_each(|place| self.note(place));
    }

    /// Returns the index of an item that was marked as changed, and removes the mark. `None` if no item is marked.
    pub(in crate::gateway) fn next_changed(&mut self) -> Option<usize> {
        let place = self.places.pop()?;
        self.is_noted[place] = false;
        Some(place)
    }

    fn note(&mut self, place: usize) {
        if !std::mem::replace(&mut self.is_noted[place], true) {
            self.places.push(place);
        }
    }
}

impl<T> Index<usize> for DirtyVec<T> {
    type Output = T;

    fn index(&self, place: usize) -> &T {
        &self.items[place]
    }
}

impl<T> IndexMut<usize> for DirtyVec<T> {
    fn index_mut(&mut self, place: usize) -> &mut T {
        self.note(place);
        &mut self.items[place]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_change_is_reported_once_and_looking_is_none() {
        let mut list = DirtyVec::new(vec![1, 2, 3]);
        while list.next_changed().is_some() {}
        assert_eq!((list[1], list.as_slice().iter().sum::<i32>()), (2, 6));
        assert_eq!(list.next_changed(), None);
        list[2] += 1;
        list[2] += 1;
        list[0] += 1;
        let mut changed: Vec<usize> = std::iter::from_fn(|| list.next_changed()).collect();
        changed.sort_unstable();
        assert_eq!((changed, list.as_slice()), (vec![0, 2], &[2, 2, 5][..]));
        list.note_all();
        assert_eq!(std::iter::from_fn(|| list.next_changed()).count(), list.len());
    }
}
