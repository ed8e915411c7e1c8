/** Numbers and checksums (section 1). */

import { check, CorruptError } from "./errors.js";

/** Four tables: what a byte does to the CRC 0 to 3 bytes later. */
const CRC_TABLES = new Int32Array(1024).fill(0).map((_, byte) => {
  for (let bit = 0; bit < 8; bit++) byte = byte >>> 1 ^ (byte & 1 ? 0xEDB88320 : 0);
  return byte;
});
for (let i = 256; i < 1024; i++) {
  const before = CRC_TABLES[i - 256];
  CRC_TABLES[i] = before >>> 8 ^ CRC_TABLES[before & 255];
}

/** Reads little-endian numbers from bytes; to read beyond `end` is corrupt. */
export class Cursor {
  constructor(bytes, at = 0, end = bytes.length) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
    this.at = at;
    this.end = end;
  }

  get left() {
    return this.end - this.at;
  }

  /** Pass `count` bytes; return where they start. */
  skip(count) {
    check(count <= this.left, "it ends too early.");
    this.at += count;
    return this.at - count;
  }

  /** Return the next bytes, not copied. */
  take(count) {
    const start = this.skip(count);
    return this.bytes.subarray(start, start + count);
  }

  u8() {
    return this.bytes[this.skip(1)];
  }

  i8() {
    return this.view.getInt8(this.skip(1));
  }

  u16() {
    return this.view.getUint16(this.skip(2), true);
  }

  u32() {
    return this.view.getUint32(this.skip(4), true);
  }

  /** A BigInt, as the next one. */
  u64() {
    return this.view.getBigUint64(this.skip(8), true);
  }

  i64() {
    return this.view.getBigInt64(this.skip(8), true);
  }

  /** A varint as a BigInt. */
  varint() {
    let value = 0n;
    for (let shift = 0n; shift < 63n; shift += 7n) {
      const byte = this.u8();
      value |= BigInt(byte & 127) << shift;
      if (byte < 128) {
        check(byte || !shift, "a varint is longer than it must be.");
        return value;
      }
    }
    throw new CorruptError("a varint has over 9 bytes.");
  }

  /** A varint of at most 32 bits. */
  varint32() {
    const value = this.varint();
    check(value < 2n ** 32n, "a varint has over 32 bits.");
    return Number(value);
  }
}

/** Map 0, 1, 2, 3, 4 to 0, -1, 1, -2, 2. */
export function unzigzag(value) {
  return value >>> 1 ^ -(value & 1);
}

/** Return the CRC of bytes; `crc` is that of those before. */
export function crc32(bytes, crc = 0) {
  const T = CRC_TABLES, whole = bytes.length & ~3;
  let c = ~crc, i = 0;
  for (; i < whole; i += 4) {
    c ^= bytes[i] | bytes[i + 1] << 8 | bytes[i + 2] << 16 | bytes[i + 3] << 24;
    c = T[768 + (c & 255)] ^ T[512 + (c >>> 8 & 255)] ^ T[256 + (c >>> 16 & 255)] ^ T[c >>> 24];
  }
  for (; i < bytes.length; i++) c = T[(c ^ bytes[i]) & 255] ^ c >>> 8;
  return ~c >>> 0;
}
