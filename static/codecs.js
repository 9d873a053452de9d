// Reads from the head of an MP4 which codecs it holds, because Media Source Extensions want to know beforehand.

const hex = (byte) => byte.toString(16).padStart(2, "0");

function find(bytes, name, from = 0) {
  const [a, b, c, d] = [...name].map((letter) => letter.charCodeAt(0));
  for (let i = from; i + 4 <= bytes.length; i += 1) {
    if (bytes[i] === a && bytes[i + 1] === b && bytes[i + 2] === c && bytes[i + 3] === d) return i;
  }
  return -1;
}

/** Byte length of the head (`ftyp` and `moov`) at the beginning of `bytes`, or 0 while it is not complete. */
export function headLength(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  for (let position = 0; position + 8 <= bytes.length; ) {
    const size = view.getUint32(position);
    const name = String.fromCharCode(...bytes.subarray(position + 4, position + 8));
    if (size < 8) throw new Error(`not a streamable MP4: box ${name} of ${size} bytes`);
    position += size;
    if (name === "moov") return position <= bytes.length ? position : 0;
  }
  return 0;
}

/** MIME type with codecs of an MP4 whose complete head is in `bytes`; H.264 and AAC only. */
export function mimeType(bytes) {
  const codecs = [];
  const avc = find(bytes, "avcC");
  if (avc >= 0) codecs.push(`avc1.${hex(bytes[avc + 5])}${hex(bytes[avc + 6])}${hex(bytes[avc + 7])}`);
  if (find(bytes, "mp4a") >= 0) codecs.push("mp4a.40.2");
  if (codecs.length === 0) throw new Error("the MP4 holds neither H.264 nor AAC");
  return `video/mp4; codecs="${codecs.join(",")}"`;
}
