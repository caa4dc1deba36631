//! Photometric units at the border: exposure, colour temperature, normalized lights.
