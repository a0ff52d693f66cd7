"""A procedural walker: a body, a manner, a path and a pace become a clip with planted feet."""
