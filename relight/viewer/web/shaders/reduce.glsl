// The brightest value of 8 x 8 pixels.
uniform sampler2D source;

void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * 8, size = textureSize(source, 0);
  float brightest = 0.0;
  for (int row = 0; row < 8; row++) {
    for (int column = 0; column < 8; column++) {
      vec3 rgb = texelFetch(source, min(first + ivec2(column, row), size - 1), 0).rgb;
      brightest = max(brightest, max(rgb.r, max(rgb.g, rgb.b)));
    }
  }
  result = vec4(brightest);
}
