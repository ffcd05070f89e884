//! No file crashes the program. It rejects each one with a sentence, soon, and without using all memory. Meanwhile a
//! gateway on the same computer compensates its machine on time.

mod decks;
mod logs;
mod parquet;
mod profiles;
mod rig;
