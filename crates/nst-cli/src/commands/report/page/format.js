// Numbers as people read them.

/** A number with up to `digits` significant digits: 1234, 0.035, 1.2e-5. */
export function number(value, digits = 3) {
  if (value === 0 || !Number.isFinite(value)) return String(value).replace("-", "−");
  const [mantissa, power] = value.toExponential(digits - 1).split("e");
  const short = power < -3 || power > 5;
  const text = short
    ? `${Number(mantissa)}e${Number(power)}`
    : String(Number(`${mantissa}e${power}`));
  return text.replace(/^-/, "−");
}

/** An exposure in stops, with its sign. */
export function stops(value) {
  return `${value < 0 ? "−" : "+"}${Math.abs(value).toFixed(2)} stops`;
}
