/** Shaders and weights of a method, by the names of their files. */
declare const files: Record<string, string | Uint8Array>;
export default files;
