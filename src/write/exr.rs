//! EXR pages.
