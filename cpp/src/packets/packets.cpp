#include "ocisac/packets/packets.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numbers>
#include <numeric>
#include <utility>

#include "core/levels.hpp"
#include "core/softplus.hpp"
#include "ocisac/core/constants.hpp"
#include "ocisac/core/require.hpp"
#include "packets/reed_solomon.hpp"
#include "rows/verdict.hpp"

namespace ocisac {

namespace {

constexpr std::size_t kNumberBytes = 1, kChecksumBytes = 4;
constexpr std::size_t kUsualData = 85, kMaxData = 170;   // bytes of a codeword of 255
constexpr std::size_t kMinBlocks = 4, kMaxBlocks = 256;  // each digit of the length has a block
constexpr unsigned kHeaderMask = 0x5AA5;
constexpr double kSureBit = 2;               // nats: a byte with a smaller |llr| is an erasure
constexpr double kMaxSoftBit = 60;           // nats
constexpr std::ptrdiff_t kMaxSlip = 2;       // chips
constexpr std::size_t kMaxDoubtful = 8;      // stretches
constexpr std::size_t kMaxWaiting = 131072;  // chips
constexpr double kMinPlaceVariance = 0.01;   // chips²
constexpr double kMaxPlaces = 24;            // chips: places compared, on either side
constexpr std::size_t kHeadersKept = 16;
constexpr double kLooseWalk = 2;  // chips² from header to header, over the square of their number
constexpr std::size_t kHeadersOfRate = 4;
constexpr double kEvenWalk = 1;                          // chips² from header to header
constexpr double kSteadyClock = 1;                       // nats
constexpr double kHeadersMissed = 5;                     // expected since the last one
constexpr std::size_t kUnplaced = 12;                    // stretches
constexpr double kSlipChance = 1e-4, kElsewhere = 1e-3;  // probabilities of each slip of a chip or two; of any place
constexpr double kScatterKept = 0.8;                     // of the variance about the origin, from header to header

constexpr std::array<std::uint8_t, 14> kStandard = {0, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 1};
constexpr std::array<std::uint8_t, 42> kLengthened = [] {
  std::array<std::uint8_t, 42> chips{};
  for (std::size_t k = 0; k < 42; ++k)
    chips[k] = static_cast<std::uint8_t>(k / 14 == 1 ? 1 - kStandard[k % 14] : kStandard[k % 14]);
  return chips;
}();

// x⁴ + x + 1 over the upper 12 bits of a header.
constexpr unsigned crc4(unsigned header) {
  unsigned rest = header & 0xFFF0U;
  for (unsigned bit = 15; bit >= 4; --bit)
    if (rest >> bit & 1U) rest ^= 0b10011U << (bit - 4);
  return rest;
}

// Bytes of the sequence s_n = s_(n−5) ⊕ s_(n−9), nine ones first: PN9; it prevents long runs in line code "none". The
// period is 511 bits, thus 511 bytes as well.
constexpr auto kWhitening = [] {
  std::array<std::uint8_t, 511> bytes{};
  std::array<std::uint8_t, 8 * 511> s{1, 1, 1, 1, 1, 1, 1, 1, 1};
  for (std::size_t n = 9; n < s.size(); ++n) s[n] = s[n - 5] ^ s[n - 9];
  for (std::size_t n = 0; n < s.size(); ++n) bytes[n / 8] = static_cast<std::uint8_t>(bytes[n / 8] << 1 | s[n]);
  return bytes;
}();

std::uint8_t whitening(std::size_t position) { return kWhitening[position % kWhitening.size()]; }

// Interleaver: the place of byte `position` of a cycle in all codewords, one after the other. Neighbours belong to
// different codewords, and the bytes of each codeword lie at varying places of the blocks.
std::size_t place_of(std::size_t position, const PacketLayout& layout) {
  const std::size_t coded = position % layout.coded_bytes(), symbol = coded / layout.codewords;
  return (coded + symbol) % layout.codewords * ReedSolomon::kLength + symbol;
}

void check(const PacketFormat& format) {
  require(format.block_bytes >= 1 && format.block_bytes <= 255, "block_bytes", format.block_bytes, "1 to 255");
}

std::size_t header_chips(const PacketFormat& format) { return kHeaderBytes * format.line_code.chips_per_byte(); }

std::size_t max_codewords(const PacketFormat& format) { return kMaxBlocks * format.block_bytes / 255; }

void append_bits(std::vector<std::uint8_t>& bits, unsigned value, unsigned count) {
  for (unsigned bit = count; bit-- > 0;) bits.push_back(static_cast<std::uint8_t>(value >> bit & 1U));
}

// Number, payload, CRC-32 and zeros, in Reed–Solomon words.
std::vector<ReedSolomon::Word> codewords_of(std::span<const std::uint8_t> payload, unsigned number,
                                            const PacketLayout& layout) {
  std::vector<std::uint8_t> data{static_cast<std::uint8_t>(number)};
  data.insert(data.end(), payload.begin(), payload.end());
  const std::uint32_t checksum = crc32(data);
  for (unsigned shift : {24U, 16U, 8U, 0U}) data.push_back(static_cast<std::uint8_t>(checksum >> shift));
  data.resize(layout.codewords * layout.codeword_data);
  const ReedSolomon code(layout.codeword_data);
  std::vector<ReedSolomon::Word> words;
  std::vector<std::uint8_t> part(layout.codeword_data);
  for (std::size_t word = 0; word < layout.codewords; ++word) {
    for (std::size_t symbol = 0; symbol < part.size(); ++symbol) part[symbol] = data[symbol * layout.codewords + word];
    words.push_back(code.encode(part));
  }
  return words;
}

unsigned header_of(std::size_t block, unsigned number, const PacketLayout& layout) {
  const std::size_t digit = layout.payload_bytes >> (9 - 3 * (block % 4)) & 7U;
  const auto fields = static_cast<unsigned>(block << 8 | (number & 1U) << 7 | digit << 4);
  return (fields | crc4(fields)) ^ kHeaderMask;
}

// Chips of a block: the preamble, then the bits of its header and its bytes, or of the header alone.
std::vector<std::uint8_t> chips_of_block(std::span<const std::uint8_t> bits, const PacketFormat& format) {
  const auto preamble = preamble_chips(format.preamble);
  std::vector<std::uint8_t> chips(preamble.begin(), preamble.end());
  const auto coded = format.line_code.encode(bits);
  chips.insert(chips.end(), coded.begin(), coded.end());
  return chips;
}

double least(std::span<const double> llr) {
  double result = std::abs(llr.front());
  for (double value : llr) result = std::min(result, std::abs(value));
  return result;
}

// ln of the likelihood of what a stretch shows over that of chips at random, for chips and words at any place: places
// that are compared share them. 0 for chips that are not seen.
class ChipEvidence {
 public:
  ChipEvidence(std::span<const double> llr, const LineCode& code) : code_(code), words_(llr.size()) {
    for (const double value : llr) {
      llr_.push_back(std::clamp(value, -kSureChip, kSureChip));
      bright_.push_back(std::numbers::ln2 - softplus(-llr_.back()));
    }
  }

  [[nodiscard]] std::span<const double> llr() const { return llr_; }
  [[nodiscard]] double of_chip(std::ptrdiff_t chip, bool bright) const {
    if (chip < 0 || chip >= std::ssize(llr_)) return 0;
    const auto at = static_cast<std::size_t>(chip);
    return bright ? bright_[at] : bright_[at] - llr_[at];
  }
  double of_word(std::ptrdiff_t first) {
    const std::size_t length = code_.chips_per_word();
    if (first < 0 || first + static_cast<std::ptrdiff_t>(length) > std::ssize(llr_)) return 0;
    const auto at = static_cast<std::size_t>(first);
    if (!words_[at]) words_[at] = code_.evidence(llr().subspan(at, length));
    return *words_[at];
  }
  // Of a pause of the sender: dark, bright, toggling or anything else.
  [[nodiscard]] double of_pause(std::ptrdiff_t begin, std::ptrdiff_t end) const {
    constexpr std::array kPatterns{0b00U, 0b11U, 0b01U, 0b10U};
    const std::ptrdiff_t first = std::max(begin, std::ptrdiff_t{0}), last = std::min(end, std::ssize(llr_));
    double most = 0;
    for (const unsigned pattern : kPatterns) {
      double sum = -std::log(static_cast<double>(kPatterns.size()));
      for (std::ptrdiff_t k = first; k < last; ++k) sum += of_chip(k, (pattern >> ((k - begin) % 2) & 1U) != 0);
      most = std::max(most, sum);
    }
    return most;
  }

 private:
  const LineCode& code_;
  std::vector<double> llr_, bright_;
  std::vector<std::optional<double>> words_;  // (first chip)
};

constexpr unsigned kHeaders = 1U << 12U;  // with a right checksum

constexpr std::array<std::uint16_t, kHeaders> kRightHeaders = [] {
  std::array<std::uint16_t, kHeaders> headers{};
  for (unsigned fields = 0; fields < kHeaders; ++fields)
    headers[fields] = static_cast<std::uint16_t>((fields << 4U | crc4(fields << 4U)) ^ kHeaderMask);
  return headers;
}();

// Probability of each value of a byte, from its bits. A bit says no more than a chip: 01 for 10 is one error.
std::array<double, 256> byte_probabilities(std::span<const double> llr) {
  std::array<double, 256> of_value{1.0};
  for (std::size_t bit = 0; bit < 8; ++bit) {
    const double zero = 1 / (1 + std::exp(std::clamp(llr[bit], -kSureChip, kSureChip)));
    for (std::size_t value = std::size_t{1} << bit; value-- > 0;) {
      const double before = of_value[value];
      of_value[2 * value] = before * zero;
      of_value[2 * value + 1] = before * (1 - zero);
    }
  }
  return of_value;
}

// The most probable header with a right checksum, if it and `evidence` (nats) of the chips before it are sure. `llr`:
// (16) of its bits; `chance`: of any block there.
std::optional<unsigned> decide_header(std::span<const double> llr, double chance, double evidence) {
  const auto first = byte_probabilities(llr.first(8)), second = byte_probabilities(llr.last(8));
  unsigned best = 0;
  double highest = 0, all = 0;
  for (const unsigned sent : kRightHeaders) {
    const double probability = first[sent >> 8U] * second[sent & 0xFFU];
    all += probability;
    if (probability <= highest) continue;
    highest = probability;
    best = sent ^ kHeaderMask;
  }
  evidence += std::log(all * chance * 0x10000U / kHeaders);  // over bits at random
  return highest < all * (1 - kNextToNone) * (1 + std::exp(-evidence)) ? std::nullopt : std::optional(best);
}

// The block whose preamble begins at a chip, `chance` that one does. Absent where another header, bytes, or chips at
// random may be there.
std::optional<BlockSighting> read_block(std::size_t chip, double chance, const ChipEvidence& chips,
                                        const PacketFormat& format) {
  const auto preamble = preamble_chips(format.preamble);
  const std::size_t start = preamble.size() + header_chips(format);
  // Upper bounds of the evidence that bits, and all words, can add.
  const double of_bits = std::log(0x10000U * chance / kHeaders);
  const double most = of_bits + static_cast<double>(header_chips(format) - 16) * std::numbers::ln2;
  const double sure = std::log((1 - kNextToNone) / kNextToNone);
  double evidence = 0;
  for (std::size_t k = 0; k < preamble.size(); ++k) {
    evidence += chips.of_chip(static_cast<std::ptrdiff_t>(chip + k), preamble[k] != 0);
    if (evidence + most + static_cast<double>(preamble.size() - k - 1) * std::numbers::ln2 < sure) return std::nullopt;
  }
  const auto seen = chips.llr().subspan(chip, start), words = seen.subspan(preamble.size());
  evidence += format.line_code.evidence(words);
  if (evidence + of_bits < sure) return std::nullopt;
  evidence -= std::max(format.line_code.evidence_anywhere(seen), 0.0);
  const auto header = decide_header(format.line_code.decode(words).llr, chance, evidence);
  if (!header) return std::nullopt;
  return BlockSighting{chip, *header >> 8U, *header >> 7U & 1U, *header >> 4U & 7U};
}

// Evidence that chips before a block are a pause, with words before it, rather than words.
double pause_evidence(std::span<const double> llr, std::size_t block, std::size_t pause, const LineCode& code) {
  ChipEvidence chips(llr, code);
  const auto word = static_cast<std::ptrdiff_t>(code.chips_per_word()), end = static_cast<std::ptrdiff_t>(block);
  const auto of_words_before = [&](std::ptrdiff_t chip) {
    double sum = 0;
    while ((chip -= word) >= 0) sum += chips.of_word(chip);
    return sum;
  };
  const std::ptrdiff_t begin = end - static_cast<std::ptrdiff_t>(pause);
  return chips.of_pause(begin, end) + of_words_before(begin) - of_words_before(end);
}

// `chance`: that a block begins at a chip.
std::vector<BlockSighting> read_blocks(std::span<const double> llr, const PacketFormat& format, double chance) {
  const std::size_t start = preamble_chips(format.preamble).size() + header_chips(format);
  const ChipEvidence chips(llr, format.line_code);
  std::vector<BlockSighting> found;
  for (std::size_t chip = 0; chip + start <= llr.size(); ++chip)
    if (const auto block = read_block(chip, chance, chips, format)) found.push_back(*block);
  return found;
}

// The headers that lie whole blocks apart, as most of them do; the others are chips that look like a header by chance.
std::vector<BlockSighting> on_one_clock(const std::vector<BlockSighting>& seen, std::size_t block_chips) {
  std::vector<std::size_t> votes(block_chips);
  for (const auto& sighting : seen) ++votes[sighting.chip % block_chips];
  const std::size_t most = *std::ranges::max_element(votes);
  std::vector<BlockSighting> kept;
  std::ranges::copy_if(seen, std::back_inserter(kept),
                       [&](const BlockSighting& sighting) { return votes[sighting.chip % block_chips] == most; });
  return kept;
}

std::ptrdiff_t modulo(std::ptrdiff_t value, std::ptrdiff_t period) { return (value % period + period) % period; }

// Difference around a cycle, at most half of it.
double difference(double a, double b, std::ptrdiff_t period) {
  return std::remainder(a - b, static_cast<double>(period));
}

// Decodes one codeword from its most reliable symbols; absent where decoding fails. `reliability`: of each, nats.
std::optional<ReedSolomon::Word> decode_word(const ReedSolomon& code, const ReedSolomon::Word& symbols,
                                             std::span<const double> reliability) {
  std::array<int, ReedSolomon::kLength> order{};
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](int place) { return reliability[static_cast<std::size_t>(place)]; });
  const auto unseen =
      static_cast<std::size_t>(std::ranges::count_if(reliability, [](double r) { return r < kSureBit; }));
  const std::size_t redundancy = ReedSolomon::kLength - code.data();
  if (unseen > redundancy) return std::nullopt;
  for (const std::size_t doubtful : {std::size_t{0}, (redundancy - unseen) / 2}) {
    ReedSolomon::Word word = symbols;
    if (code.decode(word, std::span(order).first(unseen + doubtful))) return word;
  }
  return std::nullopt;
}

}  // namespace

std::span<const std::uint8_t> preamble_chips(Preamble preamble) {
  if (preamble == Preamble::lengthened) return kLengthened;
  return kStandard;
}

std::size_t block_chips(const PacketFormat& format) {
  check(format);
  return preamble_chips(format.preamble).size() +
         (kHeaderBytes + format.block_bytes) * format.line_code.chips_per_byte();
}

std::size_t longest_payload(const PacketFormat& format) {
  check(format);
  return std::min(kLongestPayload, max_codewords(format) * kMaxData - kNumberBytes - kChecksumBytes);
}

PacketLayout packet_layout(std::size_t payload_bytes, const PacketFormat& format) {
  const std::size_t longest = longest_payload(format);
  require(payload_bytes >= 1 && payload_bytes <= longest, "payload", std::to_string(payload_bytes) + " bytes",
          "1 to " + std::to_string(longest) + " bytes with blocks of " + std::to_string(format.block_bytes) + " bytes");
  const std::size_t data = kNumberBytes + payload_bytes + kChecksumBytes;
  const auto parts = [](std::size_t whole, std::size_t part) { return (whole + part - 1) / part; };
  PacketLayout layout;
  layout.payload_bytes = payload_bytes;
  layout.codewords = std::min(parts(data, kUsualData), max_codewords(format));
  layout.codeword_data = parts(data, layout.codewords);
  layout.blocks = std::max(parts(layout.coded_bytes(), format.block_bytes), kMinBlocks);
  layout.block_chips = block_chips(format);
  return layout;
}

std::vector<std::uint8_t> packet_chips(std::span<const std::uint8_t> payload, const PacketFormat& format,
                                       unsigned number) {
  require(number <= 255, "number", number, "0 to 255");
  const PacketLayout layout = packet_layout(payload.size(), format);
  const auto words = codewords_of(payload, number, layout);
  std::vector<std::uint8_t> chips, bits;
  chips.reserve(layout.cycle_chips());
  for (std::size_t block = 0; block < layout.blocks; ++block) {
    bits.clear();
    append_bits(bits, header_of(block, number, layout), 16);
    for (std::size_t position = block * format.block_bytes; position < (block + 1) * format.block_bytes; ++position) {
      const std::size_t place = place_of(position, layout);
      append_bits(bits, words[place / ReedSolomon::kLength][place % ReedSolomon::kLength] ^ whitening(position), 8);
    }
    const auto of_block = chips_of_block(bits, format);
    chips.insert(chips.end(), of_block.begin(), of_block.end());
  }
  return chips;
}

std::vector<BlockSighting> find_blocks(std::span<const double> llr, const PacketFormat& format) {
  return read_blocks(llr, format, 1 / static_cast<double>(block_chips(format)));
}

bool PacketAssembler::Vote::change(unsigned seen) {
  constexpr int kMost = 2;  // a change of the sender's is followed at the second header that shows it
  if (count > 0 && seen == value) {
    count = std::min(count + 1, kMost);
    return false;
  }
  if (--count > 0) return false;
  const bool another = count == 0;
  value = seen;
  count = 1;
  return another;
}

PacketAssembler::PacketAssembler(PacketFormat format)
    : format_(std::move(format)), block_chips_(block_chips(format_)) {}

void PacketAssembler::lose_clock() {
  ++epoch_;
  origin_.reset();
  doubtful_.reset();
  end_.reset();
  headers_.clear();
  joined_.clear();
  if (pauses_.value != pause_) pauses_ = {};  // the same headers may be read again
}

void PacketAssembler::restart() {
  lose_clock();
  waiting_.clear();
  waiting_chips_ = 0;
  tail_.clear();
  scatter_ = slips_ = 0;
  std::ranges::fill(soft_bits_, 0.0F);
}

// Drops the collected symbols: they belong to another packet.
void PacketAssembler::start_packet() {
  layout_.reset();
  origin_.reset();
  doubtful_.reset();
  joined_.clear();
  soft_bits_.clear();
}

// The light has the other polarity: what was read of headers before was read wrong.
void PacketAssembler::turn() {
  inverted_ = !inverted_;
  const auto turn_chips = [](std::vector<double>& chips) {
    for (double& chip : chips) chip = -chip;
  };
  turn_chips(tail_);
  for (Stretch& stretch : waiting_) {
    turn_chips(stretch.llr);
    stretch.blocks.clear();
  }
  parity_ = {};
  digits_ = {};
  headers_.clear();
  start_packet();
}

void PacketAssembler::read_header(const BlockSighting& sighting) {
  if (parity_.change(sighting.parity)) {
    digits_ = {};
    start_packet();
  }
  if (sighting.parity == parity_.value && digits_[sighting.block % 4].change(sighting.digit)) start_packet();
}

void PacketAssembler::find_layout() {
  std::size_t length = 0;
  for (const Vote& digit : digits_) {
    if (digit.count == 0) return;
    length = length << 3 | digit.value;
  }
  if (length >= 1 && length <= longest_payload(format_)) use_layout(length);
}

void PacketAssembler::use_layout(std::size_t payload_bytes) {
  layout_ = packet_layout(payload_bytes, format_);
  soft_bits_.assign(8 * layout_->coded_bytes(), 0);
}

// Where headers with some digit of the length are never seen: the payload of one of the lengths that the others allow,
// if what waits is enough for it. Lengths of as many codewords have their bytes at the same places.
std::optional<Payload> PacketAssembler::try_lengths() {
  if (waiting_.size() < kUnplaced || headers_.empty()) return std::nullopt;
  const std::size_t bytes = waiting_chips_ / format_.line_code.chips_per_byte();
  std::optional<PacketAssembler> trial;
  std::vector<double> reliability;
  for (std::size_t length = 1; length + kNumberBytes + kChecksumBytes <= bytes && length <= longest_payload(format_);
       ++length) {
    bool allowed = true;
    for (std::size_t digit = 0; digit < digits_.size(); ++digit)
      allowed = allowed && (digits_[digit].count == 0 || digits_[digit].value == (length >> (9 - 3 * digit) & 7U));
    if (!allowed) continue;
    const PacketLayout layout = packet_layout(length, format_);
    if (!trial || trial->layout_->codewords != layout.codewords) {
      trial = *this;
      trial->use_layout(length);
      StretchReport unused;
      trial->place_waiting(unused);
      reliability = trial->reliabilities();
    }
    trial->layout_ = layout;
    auto payload = trial->decode(reliability);
    if (!payload) continue;
    for (std::size_t digit = 0; digit < digits_.size(); ++digit)
      trial->digits_[digit].change(static_cast<unsigned>(length >> (9 - 3 * digit) & 7U));
    std::ranges::fill(trial->soft_bits_, 0.0F);
    trial->joined_.clear();
    *this = std::move(*trial);
    return payload;
  }
  return std::nullopt;
}

// The pause between blocks that two pairs of headers show, where the chips before the later one, the last ones, are a
// pause rather than words. Chips that may be either follow a steady clock.
void PacketAssembler::learn_pause(const Header& header, std::optional<double> told_drift) {
  if (headers_.empty()) return;
  const Header& last = headers_.back();
  auto blocks = static_cast<std::ptrdiff_t>(header.block) - static_cast<std::ptrdiff_t>(last.block);
  if (layout_) blocks = modulo(blocks, static_cast<std::ptrdiff_t>(layout_->blocks));
  if (blocks <= 0 || header.slips > last.slips) return;
  const double pause = (header.chip - last.chip) / static_cast<double>(blocks) - static_cast<double>(block_chips_);
  const double whole = std::nearbyint(pause);
  unsigned shown = 0;
  if (whole > 0) {
    const auto chip = static_cast<std::size_t>(header.chip - header.place);
    const double evidence = pause_evidence(tail_, chip, static_cast<std::size_t>(whole), format_.line_code);
    const double drift = pause * static_cast<double>(blocks) / (header.time - last.time);
    if (evidence <= 0 && told_drift && std::abs(drift - *told_drift) < kMostly) return;  // or a wrong row time
    const bool is_whole = std::abs(pause - whole) < std::sqrt(kMinPlaceVariance);
    const bool is_steady = !drift_ && scatter_ <= kMinPlaceVariance;
    if (evidence >= (!is_whole ? kSureChip : is_steady ? -kSteadyClock : 0))
      shown = static_cast<unsigned>(whole);
    else if (evidence > 0)
      return;  // by chance, or too little of the pause is seen
  }
  pauses_.change(shown);
  if (pauses_.count < 2 || pauses_.value == pause_) return;
  pause_ = pauses_.value;
  drift_.reset();
  origin_.reset();
  joined_.clear();
  std::ranges::fill(soft_bits_, 0.0F);
}

// The drift and walk of the clock from its headers, less those of jumps: medians. Absent for too few headers.
std::optional<PacketAssembler::Drift> PacketAssembler::drift_of_headers() const {
  struct Step {
    double time, moved, chips;  // between stretches; of the origin; sent
  };
  std::vector<Step> steps;
  for (std::size_t k = 1; k < headers_.size(); ++k) {
    const Header &before = headers_[k - 1], &after = headers_[k];
    const double blocks = static_cast<double>(after.block) - static_cast<double>(before.block);
    const double moved = difference(after.chip - before.chip, blocks * static_cast<double>(period()), cycle());
    if (after.time > before.time)
      steps.push_back({after.time - before.time, moved, after.place - before.place - moved});
  }
  if (steps.size() < 2) return std::nullopt;
  const auto median_of = [&](auto&& value) {
    std::vector<double> values;
    for (const Step& step : steps) values.push_back(value(step));
    return median(std::move(values));
  };
  const double time = median_of([](const Step& step) { return step.time; });
  const double rate = median_of([](const Step& step) { return step.moved / step.time; });
  const double walk =
      median_of([&](const Step& step) { return std::pow(step.moved - rate * step.time, 2) / step.time; });
  const double chips = median_of([](const Step& step) { return step.chips / step.time; });
  const auto count = static_cast<double>(steps.size());
  const bool one_way = std::ranges::all_of(steps, [&](const Step& step) { return step.moved * rate > 0; });
  return Drift{rate,  walk / (kMedianMagnitude * kMedianMagnitude) + kLooseWalk / (count * count * time),
               chips, steps.size(),
               time,  one_way};
}

void PacketAssembler::learn_drift() {
  if (const auto drift = drift_of_headers()) drift_ = drift;
}

// True where each header since the first is as much further off, which looks like a jump.
bool PacketAssembler::drifts() const {
  const auto drift = drift_ ? std::nullopt : drift_of_headers();
  return drift && drift->one_way && std::abs(drift->rate) * drift->step > kMostly;
}

std::optional<double> PacketAssembler::even_rate() const {
  const bool even = drift_ && drift_->headers >= kHeadersOfRate && drift_->walk * drift_->step <= kEvenWalk;
  return even ? std::optional(drift_->chips) : std::nullopt;
}

void PacketAssembler::set_rate(double chips) {
  double counted = chips, now = 0, error = 0;
  if (drift_ && !headers_.empty()) {
    counted = drift_->chips + drift_->rate;
    now = headers_.back().time;
  } else if (waiting_.size() > 1 && waiting_.front().time() < waiting_.back().time()) {
    const Stretch &first = waiting_.front(), &last = waiting_.back();
    now = last.time();
    counted = (last.place() - first.place()) / (now - first.time());
    error = 1 / std::sqrt(12.0);  // a wrong clock rounded the places
  }
  const auto moved = [&](double time) { return (chips - counted) * (now - time); };
  for (Stretch& stretch : waiting_) {
    const double off = moved(stretch.time());
    const auto whole = static_cast<std::ptrdiff_t>(std::nearbyint(off));
    stretch.first -= whole;
    stretch.blocks_first -= whole;
    stretch.errors.offset -= off - static_cast<double>(whole);
    stretch.errors.scatter = std::hypot(stretch.errors.scatter, error);
  }
  for (Header& header : headers_) {
    header.chip -= moved(header.time);
    header.place -= moved(header.time);
  }
  if (origin_) origin_->chip -= moved(origin_->time);
  drift_.reset();
  doubtful_.reset();
  joined_.clear();
  scatter_ = 0;
}

// The blocks whose headers end in a stretch, of either polarity.
PacketAssembler::Stretch PacketAssembler::search(std::ptrdiff_t first, std::span<const double> llr,
                                                 const PlaceErrors& errors) {
  if (end_ != first) tail_.clear();
  end_ = first + static_cast<std::ptrdiff_t>(llr.size());
  const std::ptrdiff_t blocks_first = first - static_cast<std::ptrdiff_t>(tail_.size());
  for (const double chip : llr) tail_.push_back(inverted_ ? -chip : chip);
  slips_ += errors.slip * errors.slip;
  const double place = static_cast<double>(blocks_first) + errors.offset;
  const auto blocks_of = [this](std::span<const double> chips) {
    return on_one_clock(read_blocks(chips, format_, 1 / static_cast<double>(period())), period());
  };
  auto blocks = blocks_of(tail_);
  if (!blocks.empty()) {
    polarity_.change(inverted_);
  } else if (polarity_.count < 2 || headers_missed_ >= kHeadersMissed) {
    std::vector<double> other(tail_.size());
    std::ranges::transform(tail_, other.begin(), std::negate{});
    auto turned = blocks_of(other);
    if (!turned.empty()) polarity_.change(!inverted_);
    if (!turned.empty() && (polarity_.value != 0) != inverted_) {
      turn();
      blocks = std::move(turned);
    }
  }
  for (const BlockSighting& block : blocks) {
    const Header header{errors.time.value_or(place), place, place + static_cast<double>(block.chip), block.block,
                        slips_};
    learn_pause(header, errors.told_drift);
    if (!headers_.empty() && headers_.back().place == place) headers_.pop_back();
    headers_.push_back(header);
  }
  if (headers_.size() > kHeadersKept) headers_.pop_front();
  const auto own = tail_.end() - std::ssize(llr);
  Stretch stretch{first, epoch_, {own, tail_.end()}, blocks_first, std::move(blocks), errors, slips_, {}};
  const std::size_t kept = preamble_chips(format_.preamble).size() + header_chips(format_) - 1;
  if (tail_.size() > kept) tail_.erase(tail_.begin(), tail_.end() - static_cast<std::ptrdiff_t>(kept));
  return stretch;
}

void PacketAssembler::keep(Stretch stretch) {
  waiting_chips_ += stretch.llr.size();
  waiting_.push_back(std::move(stretch));
  while (waiting_chips_ > kMaxWaiting) {
    waiting_chips_ -= waiting_.front().llr.size();
    waiting_.pop_front();
  }
}

std::ptrdiff_t PacketAssembler::origin_by(const Stretch& stretch, const BlockSighting& sighting) const {
  return stretch.blocks_first + static_cast<std::ptrdiff_t>(sighting.chip) -
         static_cast<std::ptrdiff_t>(sighting.block * period());
}

// Variance of the clock between a stretch and the origin.
double PacketAssembler::walk_since(const Stretch& stretch, const Origin& origin) const {
  return drift_ ? drift_->walk * std::abs(stretch.time() - origin.time) : std::abs(stretch.slips - origin.slips);
}

// Variance of a stretch's place about the one by the origin.
double PacketAssembler::place_variance(const Stretch& stretch, const Origin& origin) const {
  return origin.variance + walk_since(stretch, origin) +
         std::max(stretch.errors.scatter * stretch.errors.scatter, scatter_);
}

// The origin, where the clock has drifted to until a stretch.
double PacketAssembler::origin_at(const Stretch& stretch, const Origin& origin) const {
  return origin.chip + (drift_ ? drift_->rate * (stretch.time() - origin.time) : 0.0);
}

// Updates the origin from the headers of a stretch, until one disagrees with it; `breaks`: as the last one did, about
// another origin.
PacketAssembler::Agreement PacketAssembler::follow(Stretch& stretch) {
  for (const auto& sighting : stretch.blocks) {
    if (sighting.parity != parity_.value || sighting.block >= layout_->blocks) return Agreement::disagrees;
    stretch.origin = origin_by(stretch, sighting);
    const double seen = static_cast<double>(*stretch.origin) + stretch.errors.offset;
    const double own = stretch.errors.scatter * stretch.errors.scatter;
    const double variance = origin_ ? place_variance(stretch, *origin_) : 0;
    const double off = origin_ ? difference(seen, origin_at(stretch, *origin_), cycle()) : 0;
    const double allowed = static_cast<double>(kMaxSlip) + 0.5 + kSure * std::sqrt(variance);
    const bool contradicts = origin_ && std::abs(off) > allowed;
    if (origin_ && drifts()) return Agreement::breaks;
    if (contradicts && !doubtful_) {
      doubtful_ = *stretch.origin;
      return Agreement::disagrees;
    }
    if (contradicts && std::abs(difference(seen, static_cast<double>(*doubtful_), cycle())) > allowed) {
      doubtful_ = *stretch.origin;
      return Agreement::breaks;
    }
    if (contradicts) take_back();
    if (!origin_ || contradicts) {
      origin_ = {seen, std::max(own, scatter_), stretch.time(), stretch.slips};
    } else {
      const double walk = origin_->variance + walk_since(stretch, *origin_);
      const double gain = std::max(walk, kMinPlaceVariance) / std::max(variance, kMinPlaceVariance);
      scatter_ = kScatterKept * scatter_ + (1 - kScatterKept) * std::max(off * off - walk, 0.0);
      origin_ = {origin_at(stretch, *origin_) + gain * off, std::max(1 - gain, 0.0) * walk, stretch.time(),
                 stretch.slips};
    }
    doubtful_.reset();
  }
  return Agreement::agrees;
}

// Uses the first chip, before the stretch or in it, of each block that a stretch at a place of the cycle has a part of.
template <class UseBlock>
void PacketAssembler::for_blocks(std::size_t chips, std::ptrdiff_t place, UseBlock&& use) const {
  const auto length = static_cast<std::ptrdiff_t>(period()), end = static_cast<std::ptrdiff_t>(chips);
  auto block = static_cast<std::size_t>(place / length);
  for (std::ptrdiff_t start = -(place % length); start < end; start += length) {
    use(start, block);
    block = (block + 1) % layout_->blocks;
  }
}

// The chips of a block; 0: not seen.
std::vector<double> PacketAssembler::block_at(std::span<const double> llr, std::ptrdiff_t start) const {
  std::vector<double> chips(block_chips_);
  const auto end = std::min(start + static_cast<std::ptrdiff_t>(block_chips_), std::ssize(llr));
  for (std::ptrdiff_t chip = std::max(start, std::ptrdiff_t{0}); chip < end; ++chip)
    chips[static_cast<std::size_t>(chip - start)] = llr[static_cast<std::size_t>(chip)];
  return chips;
}

// Evidence of all chips at a place of the cycle: preambles, headers, line code.
template <class Evidence>
double PacketAssembler::evidence(Evidence& chips, std::ptrdiff_t place) const {
  const auto word = static_cast<std::ptrdiff_t>(format_.line_code.chips_per_word());
  double sum = 0;
  std::vector<std::uint8_t> bits;
  for_blocks(chips.llr().size(), place, [&](std::ptrdiff_t start, std::size_t block) {
    const auto end = std::min(start + static_cast<std::ptrdiff_t>(block_chips_), std::ssize(chips.llr()));
    bits.clear();
    append_bits(bits, header_of(block, parity_.value, *layout_), 16);
    std::ptrdiff_t chip = start;
    for (const std::uint8_t bright : chips_of_block(bits, format_)) sum += chips.of_chip(chip++, bright != 0);
    for (; chip + word <= end; chip += word) sum += chips.of_word(chip);
    if (pause_ > 0)
      sum += chips.of_pause(start + static_cast<std::ptrdiff_t>(block_chips_),
                            start + static_cast<std::ptrdiff_t>(period()));
  });
  return sum;
}

// The place in the cycle of a stretch without headers, by the origins before and after it; absent where several places,
// or none, may be right.
std::optional<std::ptrdiff_t> PacketAssembler::likely_place(const Stretch& stretch,
                                                            std::span<const Origin> origins) const {
  double weights = 0;
  for (const Origin& origin : origins) weights += 1 / std::max(place_variance(stretch, origin), kMinPlaceVariance);
  std::map<std::ptrdiff_t, double> priors;  // of places
  for (const Origin& origin : origins) {
    const double variance = std::max(place_variance(stretch, origin), kMinPlaceVariance);
    const double deviation = std::sqrt(variance), weight = 1 / (variance * weights);
    const double expected = stretch.place() - origin_at(stretch, origin);
    const double nearest = std::nearbyint(expected);
    const double most = drift_ ? 0.5 * static_cast<double>(period()) : kMaxPlaces;
    if (!(std::abs(nearest) < kMostCounted)) continue;  // after a pause without end
    const double reach = std::clamp(std::ceil(kSure * deviation), static_cast<double>(kMaxSlip), most);
    for (double away = -reach; away <= reach; ++away) {
      const double errors = (nearest + away - expected) / deviation;
      const double slip = std::abs(away) <= static_cast<double>(kMaxSlip) ? kSlipChance : 0.0;
      priors[modulo(static_cast<std::ptrdiff_t>(nearest + away), cycle())] +=
          weight * (std::exp(-0.5 * errors * errors) / (deviation * std::sqrt(kTwoPi)) + slip);
    }
  }
  if (priors.empty()) return std::nullopt;
  ChipEvidence evidence_of(stretch.llr, format_.line_code);
  std::vector<std::pair<double, std::ptrdiff_t>> places;  // ln of the probability
  for (const auto& [place, prior] : priors)
    places.emplace_back(std::log(std::max(prior, 1e-300)) + evidence(evidence_of, place), place);
  const double elsewhere = std::log(kElsewhere) + format_.line_code.evidence_anywhere(evidence_of.llr());
  const auto most = std::ranges::max_element(places);
  double all = std::exp(std::min(elsewhere - most->first, 700.0));
  for (const auto& [logarithm, place] : places) all += std::exp(logarithm - most->first);
  if (1 < (1 - kNextToNone) * all) return std::nullopt;
  return most->second;
}

void PacketAssembler::place_block(std::span<const double> chips, std::size_t block, float sign, StretchReport& report) {
  const std::size_t byte_chips = format_.line_code.chips_per_byte();
  const auto body = chips.subspan(preamble_chips(format_.preamble).size() + kHeaderBytes * byte_chips);
  for (std::size_t byte = 0; byte < format_.block_bytes; ++byte) {
    const auto of_byte = body.subspan(byte * byte_chips, byte_chips);
    const auto unseen = static_cast<std::size_t>(std::ranges::count(of_byte, 0.0));
    if (unseen == byte_chips) continue;
    const LineDecoding decoded = format_.line_code.decode(of_byte);
    report.violations += static_cast<std::size_t>(std::ranges::count(decoded.violations, 1));
    ++(least(decoded.llr) >= kSureBit ? report.bytes : unseen > 0 ? report.cut : report.doubtful);
    const std::size_t position = block * format_.block_bytes + byte;
    float* const soft = &soft_bits_[8 * place_of(position, *layout_)];
    for (std::size_t bit = 0; bit < 8; ++bit) {
      const bool inverted = (whitening(position) >> (7 - bit) & 1U) != 0;
      const double llr = std::clamp(decoded.llr[bit], -kMaxSoftBit, kMaxSoftBit);
      soft[bit] += sign * static_cast<float>(inverted ? -llr : llr);
    }
  }
}

void PacketAssembler::add(const Stretch& stretch, float sign, StretchReport& report) {
  for_blocks(stretch.llr.size(), *stretch.joined, [&](std::ptrdiff_t start, std::size_t block) {
    place_block(block_at(stretch.llr, start), block, sign, report);
  });
}

// Stretches that were placed since the last header have no place: the next one contradicts the clock.
void PacketAssembler::take_back() {
  StretchReport unused;
  for (const Stretch& stretch : joined_) add(stretch, -1, unused);
  joined_.clear();
}

void PacketAssembler::place_waiting(StretchReport& report) {
  std::erase_if(waiting_, [&](Stretch& stretch) {  // where the clock is gone, headers alone have a place
    if (stretch.epoch == epoch_) return false;
    if (!stretch.blocks.empty() && stretch.blocks.back().parity == parity_.value &&
        stretch.blocks.back().block < layout_->blocks) {
      stretch.joined = modulo(stretch.first - origin_by(stretch, stretch.blocks.back()), cycle());
      add(stretch, 1, report);
    }
    return true;
  });
  std::vector<bool> agrees;
  std::vector<std::optional<Origin>> origins;  // for each stretch, by the headers up to it
  const auto follow_all = [&] {
    doubtful_.reset();  // only another stretch may confirm a doubtful header
    agrees.clear();
    origins.clear();
    bool breaks = false;
    for (Stretch& stretch : waiting_) {
      const Agreement agreement = follow(stretch);
      breaks = breaks || agreement == Agreement::breaks;
      agrees.push_back(agreement == Agreement::agrees);
      origins.push_back(origin_);
    }
    return breaks;
  };
  if (drift_) learn_drift();
  if (follow_all()) {
    take_back();
    learn_drift();
    if (drift_) {
      origin_.reset();
      scatter_ = 0;
    }
    follow_all();
  }
  if (!origin_) return;
  std::optional<Origin> next;
  std::deque<Stretch> still;
  for (std::size_t k = waiting_.size(); k-- > 0;) {
    Stretch& stretch = waiting_[k];
    if (!agrees[k]) continue;
    if (stretch.origin) {
      stretch.joined = modulo(stretch.first - *stretch.origin, cycle());
      next = origins[k];
      continue;
    }
    std::vector<Origin> about;
    if (origins[k]) about.push_back(*origins[k]);
    if (next) about.push_back(*next);
    if (!about.empty()) stretch.joined = likely_place(stretch, about);
  }
  for (Stretch& stretch : waiting_) {
    if (!stretch.joined) {
      still.push_back(std::move(stretch));
      continue;
    }
    add(stretch, 1, report);
    if (stretch.origin)
      joined_.clear();
    else
      joined_.push_back(std::move(stretch));
  }
  while (still.size() > kMaxDoubtful) still.pop_front();
  if (joined_.size() > kMaxDoubtful) joined_.erase(joined_.begin());
  waiting_ = std::move(still);
  waiting_chips_ = 0;
  for (const auto& stretch : waiting_) waiting_chips_ += stretch.llr.size();
}

std::vector<double> PacketAssembler::reliabilities() const {
  std::vector<double> result(soft_bits_.size() / 8);
  for (std::size_t symbol = 0; symbol < result.size(); ++symbol) {
    double lowest = std::abs(soft_bits_[8 * symbol]);
    for (std::size_t bit = 1; bit < 8; ++bit) lowest = std::min<double>(lowest, std::abs(soft_bits_[8 * symbol + bit]));
    result[symbol] = lowest;
  }
  return result;
}

std::optional<Payload> PacketAssembler::decode(std::span<const double> reliability) const {
  const ReedSolomon code(layout_->codeword_data);
  std::vector<std::uint8_t> data(layout_->codewords * layout_->codeword_data);
  Payload payload;
  for (std::size_t word = 0; word < layout_->codewords; ++word) {
    const std::size_t first = word * ReedSolomon::kLength;
    const auto of_word = reliability.subspan(first, ReedSolomon::kLength);
    ReedSolomon::Word symbols{};
    for (std::size_t bit = 0; bit < 8 * symbols.size(); ++bit)
      symbols[bit / 8] = static_cast<std::uint8_t>(symbols[bit / 8] << 1 | (soft_bits_[8 * first + bit] > 0));
    const auto decoded = decode_word(code, symbols, of_word);
    if (!decoded) return std::nullopt;
    for (std::size_t symbol = 0; symbol < ReedSolomon::kLength; ++symbol)
      if (of_word[symbol] >= kSureBit && (*decoded)[symbol] != symbols[symbol]) ++payload.corrected;
    for (std::size_t symbol = 0; symbol < layout_->codeword_data; ++symbol)
      data[symbol * layout_->codewords + word] = (*decoded)[symbol];
  }
  const auto checked = std::span(data).first(kNumberBytes + layout_->payload_bytes);
  std::uint32_t checksum = 0;
  for (std::size_t byte = 0; byte < kChecksumBytes; ++byte) checksum = checksum << 8 | data[checked.size() + byte];
  if (crc32(checked) != checksum || (data[0] & 1U) != parity_.value) return std::nullopt;
  payload.number = data[0];
  payload.bytes.assign(checked.begin() + kNumberBytes, checked.end());
  return payload;
}

Lack PacketAssembler::lack_after(const StretchReport& report, std::span<const double> llr) {
  const auto sure = std::ranges::count_if(llr, [](double chip) { return std::abs(chip) >= kSureBit; });
  if (2 * static_cast<std::size_t>(sure) < llr.size()) return Lack::none;
  const std::size_t start = preamble_chips(format_.preamble).size() + header_chips(format_);
  headers_missed_ = report.blocks > 0 ? 0.0
                    : llr.size() >= start
                        ? headers_missed_ + static_cast<double>(llr.size() - start + 1) / static_cast<double>(period())
                        : headers_missed_;
  unplaced_ = report.outcome == StretchOutcome::waiting ? unplaced_ + 1 : 0;
  return headers_missed_ >= kHeadersMissed ? Lack::header : unplaced_ >= kUnplaced ? Lack::place : Lack::none;
}

StretchReport PacketAssembler::push(std::ptrdiff_t first, std::span<const double> llr, const PlaceErrors& errors) {
  for (double value : llr) require(!std::isnan(value), "llr", value, "numbers");
  require_not_negative("scatter", errors.scatter);
  StretchReport report;
  const double doubt = kSure * std::hypot(errors.scatter, errors.slip);
  if (end_ && static_cast<double>(first) + doubt < static_cast<double>(*end_)) {
    report.outcome = StretchOutcome::repeated;
  } else if (std::ranges::all_of(llr, [](double value) { return value == 0; })) {
    report.outcome = StretchOutcome::unreadable;
  } else {
    Stretch stretch = search(first, llr, errors);
    report.blocks = stretch.blocks.size();
    for (const auto& sighting : stretch.blocks) read_header(sighting);
    keep(std::move(stretch));
    if (!layout_) find_layout();
    if (layout_)
      place_waiting(report);
    else
      report.payload = try_lengths();
    if (!waiting_.empty() && waiting_.back().first == first) report.outcome = StretchOutcome::waiting;
    report.lack = lack_after(report, llr);
  }
  report.inverted = inverted_;
  if (report.payload) report.share = 1;
  if (!layout_ || report.payload) return report;

  const auto reliability = reliabilities();
  std::size_t scarcest = ReedSolomon::kLength;
  for (auto word = reliability.begin(); word != reliability.end(); word += ReedSolomon::kLength)
    scarcest =
        std::min(scarcest, static_cast<std::size_t>(std::count_if(word, word + ReedSolomon::kLength,
                                                                  [](double value) { return value >= kSureBit; })));
  report.share = static_cast<double>(scarcest) / static_cast<double>(layout_->codeword_data);
  if (report.bytes + report.cut + report.doubtful == 0 || scarcest < layout_->codeword_data) return report;
  report.payload = decode(reliability);
  // More than twice the needed symbols that do not decode come from more than one packet.
  if (report.payload || scarcest >= std::min(2 * layout_->codeword_data + 40, ReedSolomon::kLength)) {
    std::ranges::fill(soft_bits_, 0.0F);
    joined_.clear();
  }
  return report;
}

std::uint32_t crc32(std::span<const std::uint8_t> bytes) {
  std::uint32_t rest = 0xFFFFFFFFU;
  for (std::uint8_t byte : bytes) {
    rest ^= byte;
    for (int bit = 0; bit < 8; ++bit) rest = rest >> 1 ^ (rest & 1U ? 0xEDB88320U : 0U);
  }
  return ~rest;
}

std::string_view outcome_name(StretchOutcome outcome) {
  return std::array{"placed", "waiting", "repeated", "unreadable"}[static_cast<std::size_t>(outcome)];
}

std::string_view lack_name(Lack lack) { return std::array{"none", "header", "place"}[static_cast<std::size_t>(lack)]; }

}  // namespace ocisac
