// Of 8 x 8 pixels the brightest value, in R; and in GBA the sum of their colours, over 64.
uniform sampler2D source;
uniform int first;  // 1: the source is a picture; 0: what this has made

void main() {
  ivec2 corner = ivec2(gl_FragCoord.xy) * 8, size = textureSize(source, 0);
  result = vec4(0.0);
  for (int row = 0; row < 8; row++) {
    for (int column = 0; column < 8; column++) {
      ivec2 pixel = corner + ivec2(column, row);
      if (pixel.x >= size.x || pixel.y >= size.y) continue;
      vec4 value = texelFetch(source, pixel, 0);
      if (first == 1) value = vec4(max(value.r, max(value.g, value.b)), value.rgb);
      result = vec4(max(result.r, value.r), result.gba + value.gba / 64.0);
    }
  }
}
