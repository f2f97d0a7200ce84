// What the records of a shard are decoded with.
struct Shard {
    step: vec3f,
    minimum: vec3f,
    camera: vec3f,
}
