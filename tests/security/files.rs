//! No file brings the program down: each is refused in a sentence, soon, and without the memory of the computer. Meanwhile a
//! gateway on the same computer holds its machine on time.

mod decks;
mod logs;
mod parquet;
mod profiles;
mod rig;
