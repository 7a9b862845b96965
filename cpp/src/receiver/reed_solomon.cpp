#include "ocisac/receiver/reed_solomon.hpp"

#include <algorithm>
#include <new>

#include "ocisac/require.hpp"

extern "C" {
#include <fec.h>
}

namespace ocisac {

ReedSolomon::ReedSolomon(std::size_t data) : data_(data) {
  require(data >= 1 && data < kLength, "data", data, "1 to 254 symbols");
  codec_ = {init_rs_char(8, 0x11d, 0, 1, static_cast<int>(kLength - data), 0), [](void* codec) {
              if (codec != nullptr) free_rs_char(codec);
            }};
  if (!codec_) throw std::bad_alloc();
}

ReedSolomon::Word ReedSolomon::encode(std::span<const std::uint8_t> data) const {
  require(data.size() == data_, "data", data.size(), std::to_string(data_) + " symbols");
  Word word{};
  std::ranges::copy(data, word.begin());
  encode_rs_char(codec_.get(), word.data(), word.data() + data_);
  return word;
}

bool ReedSolomon::decode(Word& word, std::span<const int> erased) const {
  if (erased.size() > kLength - data_) return false;
  Word corrected = word;
  std::array<int, kLength> places{};  // the codec writes the places of errors here
  std::ranges::copy(erased, places.begin());
  const int corrections =
      decode_rs_char(codec_.get(), corrected.data(), places.data(), static_cast<int>(erased.size()));
  if (corrections < 0) return false;
  word = corrected;
  return true;
}

}  // namespace ocisac
