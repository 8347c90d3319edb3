//! The unmodified firmware on an emulated chip.
