//! What a posterior through an emulator says in a few numbers.
