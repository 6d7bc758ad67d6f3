// Σ colour · layer over the lights, and their mean visibility.
uniform sampler2DArray layers;
uniform vec3 colours[9];
uniform float shares[9];

void main() {
  result = vec4(0.0);
  for (int slot = 0; slot < 9; slot++) {
    if (shares[slot] == 0.0) continue;
    vec4 lit = texelFetch(layers, ivec3(ivec2(gl_FragCoord.xy), slot), 0);
    result += vec4(lit.rgb * colours[slot], lit.a * shares[slot]);
  }
}
