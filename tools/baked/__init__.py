"""What a bake wrote, read back: glTF, EXR pages, world triangles with their place on the pages."""
