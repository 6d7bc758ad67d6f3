// What relight/viewer/page.py writes before the program.
declare const PYTHON: any;
declare const SHADERS: Record<string, string>;
interface Window {
  relight: any; // for tests
  relightApp: any;
}
// Modules of the viewer's program, which the application's server joins into one.
declare module "*/viewer.js";
