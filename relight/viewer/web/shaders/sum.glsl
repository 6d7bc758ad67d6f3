// Σ colour · layer over the lights, and their mean visibility.
uniform sampler2DArray layers;
uniform sampler2D positions;  // metres
uniform vec3 colours[9];
uniform float shares[9];
uniform vec4 lamps[9];  // where a light stands in the room, and its radius; below zero for a distant one

// How much of the light of a slot a surface would get that faces it.
float whole(int slot, vec3 here) {
  if (lamps[slot].w < 0.0) return 1.0;
  vec3 way = lamps[slot].xyz - here;
  float squared = max(dot(way, way), MIN_SQUARED);
  return 2.0 / (squared * (1.0 + sqrt(max(0.0, 1.0 - lamps[slot].w * lamps[slot].w / squared))));
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 here = texelFetch(positions, pixel, 0).xyz;
  float total = 0.0;
  result = vec4(0.0);
  for (int slot = 0; slot < 9; slot++) {
    if (shares[slot] == 0.0) continue;
    vec4 lit = texelFetch(layers, ivec3(pixel, slot), 0);
    float share = shares[slot] * whole(slot, here);
    total += share;
    result += vec4(lit.rgb * colours[slot], lit.a * share);
  }
  if (total > 0.0) result.a /= total;
}
