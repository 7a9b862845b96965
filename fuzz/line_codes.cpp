// Line codes: a code, by name or as a table, encodes bits from the bytes and decodes damaged chips.
#include "ocisac/packets/line_codes.hpp"

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "fuzz.hpp"

using namespace ocisac;

namespace {

LineCode code_of(FuzzedDataProvider& bytes) {
  constexpr std::array names{"none", "manchester", "4b6b", "8b10b"};
  // Codes by name are kept, and large tables seldom: to make one takes longer than the rest of a run.
  if (bytes.ConsumeBool()) {
    static std::map<std::string, LineCode> codes;
    const std::string name = bytes.PickValueInArray(names);
    auto known = codes.find(name);
    if (known == codes.end()) known = codes.emplace(name, LineCode::named(name)).first;
    return known->second;
  }
  std::vector<std::string> words(bytes.PickValueInArray<std::size_t>({2, 4, 16, 3, 0}));
  if (bytes.ConsumeIntegral<std::uint8_t>() == 1) words.resize(256);
  const auto chips = bytes.ConsumeIntegralInRange<std::size_t>(0, 17);
  for (auto& word : words) {
    const auto value = bytes.ConsumeIntegral<std::uint32_t>();
    for (std::size_t chip = 0; chip < chips; ++chip) word += (value >> chip & 1U) != 0 ? '1' : '0';
  }
  return LineCode::of_table(words);
}

// What was encoded is decoded, with likelihoods of the right sign and no violation.
void round_trip(const LineCode& code, FuzzedDataProvider& bytes) {
  std::vector<std::uint8_t> bits(code.bits_per_word() * bytes.ConsumeIntegralInRange<std::size_t>(0, 40));
  for (auto& bit : bits) bit = bytes.ConsumeBool() ? 1 : 0;
  const auto chips = code.encode(bits);
  std::vector<double> llr;
  for (const auto chip : chips) llr.push_back(chip != 0 ? 4 : -4);
  const auto decoded = code.decode(llr);
  fuzz::claim(chips.size() * code.bits_per_word() == bits.size() * code.chips_per_word());
  fuzz::claim(decoded.llr.size() == bits.size());
  for (std::size_t k = 0; k < bits.size(); ++k) fuzz::claim(bits[k] != 0 ? decoded.llr[k] > 0 : decoded.llr[k] < 0);
  for (const auto violation : decoded.violations) fuzz::claim(violation == 0);
}

void decode_any(const LineCode& code, FuzzedDataProvider& bytes) {
  std::vector<double> llr(bytes.ConsumeIntegralInRange<std::size_t>(0, 40) * code.chips_per_word() +
                          bytes.ConsumeIntegralInRange<std::size_t>(0, 2));
  for (double& chip : llr) chip = bytes.ConsumeIntegral<std::int8_t>();
  const auto decoded = code.decode(llr);
  fuzz::claim(decoded.llr.size() == decoded.violations.size() * code.bits_per_word());
  for (const double bit : decoded.llr) fuzz::claim(std::isfinite(bit));
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzedDataProvider bytes(data, size);
  fuzz::allow_refusal([&] {
    const LineCode code = code_of(bytes);
    round_trip(code, bytes);
    decode_any(code, bytes);
  });
  return 0;
}
