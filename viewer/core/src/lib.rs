//! Stub while compiling.
