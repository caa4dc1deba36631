"""The studies of `tools/study`: each module bakes one scene in several ways and says what came out."""
