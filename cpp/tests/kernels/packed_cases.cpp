#include <cstdint>

#include "kernel_cases.hpp"
#include "ocisac/camera/packed_samples.hpp"

namespace kernel_cases {

namespace {

// Samples of a row that ends with the last group, or of a part of it.
KernelCase unpack_case(ocisac::Packing packing, std::size_t first, std::size_t count, bool timed = false) {
  const bool ten = packing == ocisac::Packing::raw10;
  const std::size_t samples = ten ? 4 : 2, groups = (first + count + samples - 1) / samples;
  auto row = std::make_shared<Misaligned<std::uint8_t>>(
      random_rows<std::uint8_t>(1, groups * (samples + 1), groups * (samples + 1), 128, 80));
  const auto run = [=](bool plain, std::uint16_t* out) {
    if (!plain) return ocisac::unpack_samples(packing, row->data(), first, count, out);
    for (std::size_t i = first; i < first + count; ++i) {
      const std::uint8_t* group = row->data() + i / samples * (samples + 1);
      const std::size_t of = i % samples;
      out[i - first] = static_cast<std::uint16_t>(ten ? group[of] << 2 | (group[4] >> 2 * of & 3)
                                                      : group[of] << 4 | (group[2] >> 4 * of & 15));
    }
  };
  std::string name = ten ? "unpack_samples raw10 " : "unpack_samples raw12 ";
  name += std::to_string(first) + " + " + std::to_string(count);
  return kernel_case<std::uint16_t>(name, 0, {1, count, count}, run, timed);
}

}  // namespace

std::vector<KernelCase> packed_cases() {
  std::vector<KernelCase> cases;
  for (const auto packing : {ocisac::Packing::raw10, ocisac::Packing::raw12}) {
    for (const std::size_t count : kLengths)
      for (const std::size_t first : {0u, 1u, 3u, 10u}) cases.push_back(unpack_case(packing, first, count));
    cases.push_back(unpack_case(packing, 0, 1920, true));
  }
  return cases;
}

}  // namespace kernel_cases
