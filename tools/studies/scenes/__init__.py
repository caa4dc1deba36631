"""Scenes of the studies: made on the fly, never committed; metres, Y up, closed rooms."""
