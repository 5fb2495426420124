// As much of MessagePack as the protocol needs: nil, booleans, integers, floats, text, bin, arrays, maps.

/** Numbers that are whole become integers, all others float64; nanoseconds are BigInt, which never lose a digit. */
export function encode(value) {
  if (value === null || value === undefined) return Buffer.of(0xc0);
  if (typeof value === "boolean") return Buffer.of(value ? 0xc3 : 0xc2);
  if (typeof value === "bigint") return withNumber(0xd3, 8, (b) => b.writeBigInt64BE(value, 1));
  if (typeof value === "number") {
    // -0 is whole, but no integer can hold it.
    if (!Number.isSafeInteger(value) || Object.is(value, -0)) return withNumber(0xcb, 8, (b) => b.writeDoubleBE(value, 1));
    return value >= 0 && value < 128 ? Buffer.of(value) : encode(BigInt(value));
  }
  if (typeof value === "string") {
    const bytes = Buffer.from(value);
    return Buffer.concat([withNumber(0xdb, 4, (b) => b.writeUInt32BE(bytes.length, 1)), bytes]);
  }
  if (value instanceof Uint8Array) {
    return Buffer.concat([withNumber(0xc6, 4, (b) => b.writeUInt32BE(value.length, 1)), value]);
  }
  if (Array.isArray(value)) {
    return Buffer.concat([withNumber(0xdd, 4, (b) => b.writeUInt32BE(value.length, 1)), ...value.map(encode)]);
  }
  const entries = Object.entries(value).flat();
  return Buffer.concat([withNumber(0xdf, 4, (b) => b.writeUInt32BE(entries.length / 2, 1)), ...entries.map(encode)]);
}

/** Maps become objects; integers that a number cannot hold become BigInt. Throws for anything but one whole value. */
export function decode(bytes) {
  const reader = new Reader(bytes);
  const value = reader.value();
  if (reader.at !== bytes.length) throw new Error(`${bytes.length - reader.at} bytes too many`);
  return value;
}

function withNumber(code, size, write) {
  const bytes = Buffer.alloc(1 + size);
  bytes[0] = code;
  write(bytes);
  return bytes;
}

class Reader {
  constructor(bytes) {
    this.bytes = Buffer.from(bytes);
    this.at = 0;
  }

  value() {
    const code = this.number("readUInt8", 1);
    if (code < 0x80) return code;
    if (code < 0x90) return this.map(code & 0x0f);
    if (code < 0xa0) return this.array(code & 0x0f);
    if (code < 0xc0) return this.take(code & 0x1f).toString();
    if (code >= 0xe0) return code - 0x100;
    switch (code) {
      case 0xc0: return null;
      case 0xc2: return false;
      case 0xc3: return true;
      case 0xc4: return this.take(this.number("readUInt8", 1));
      case 0xc5: return this.take(this.number("readUInt16BE", 2));
      case 0xc6: return this.take(this.number("readUInt32BE", 4));
      case 0xca: return this.number("readFloatBE", 4);
      case 0xcb: return this.number("readDoubleBE", 8);
      case 0xcc: return this.number("readUInt8", 1);
      case 0xcd: return this.number("readUInt16BE", 2);
      case 0xce: return this.number("readUInt32BE", 4);
      case 0xcf: return small(this.number("readBigUInt64BE", 8));
      case 0xd0: return this.number("readInt8", 1);
      case 0xd1: return this.number("readInt16BE", 2);
      case 0xd2: return this.number("readInt32BE", 4);
      case 0xd3: return small(this.number("readBigInt64BE", 8));
      case 0xd9: return this.take(this.number("readUInt8", 1)).toString();
      case 0xda: return this.take(this.number("readUInt16BE", 2)).toString();
      case 0xdb: return this.take(this.number("readUInt32BE", 4)).toString();
      case 0xdc: return this.array(this.number("readUInt16BE", 2));
      case 0xdd: return this.array(this.number("readUInt32BE", 4));
      case 0xde: return this.map(this.number("readUInt16BE", 2));
      case 0xdf: return this.map(this.number("readUInt32BE", 4));
      default: throw new Error(`found 0x${code.toString(16)}; the protocol has no such value`);
    }
  }

  number(read, size) {
    const value = this.bytes[read](this.at);
    this.at += size;
    return value;
  }

  take(length) {
    if (this.at + length > this.bytes.length) throw new Error("cut short");
    return this.bytes.subarray(this.at, (this.at += length));
  }

  array(length) {
    const values = [];
    for (let i = 0; i < length; i++) values.push(this.value());
    return values;
  }

  map(length) {
    const entries = [];
    for (let i = 0; i < length; i++) entries.push([this.value(), this.value()]);
    return Object.fromEntries(entries);
  }
}

function small(value) {
  const number = Number(value);
  return Number.isSafeInteger(number) ? number : value;
}
