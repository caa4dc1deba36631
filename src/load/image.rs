//! PNG, JPEG, EXR and HDR pictures to textures.
