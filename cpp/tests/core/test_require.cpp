#include <doctest/doctest.h>

#include <stdexcept>
#include <string>

#include "ocisac/core/require.hpp"

using namespace ocisac;

namespace {

std::string message_of(const std::string& value) {
  try {
    refuse("name", value, "a word");
  } catch (const std::invalid_argument& refused) {
    return refused.what();
  }
}

}  // namespace

TEST_CASE("values in messages have at most 80 bytes and whole characters") {
  CHECK(message_of("z") == "name: got z, allowed: a word");
  CHECK(message_of(std::string(80, 'z')) == "name: got " + std::string(80, 'z') + ", allowed: a word");
  CHECK(message_of(std::string(81, 'z')) == "name: got " + std::string(77, 'z') + "..., allowed: a word");
  std::string accents;
  while (accents.size() < 200) accents += "ä";  // two bytes
  CHECK(message_of("x" + accents) == "name: got x" + accents.substr(0, 76) + "..., allowed: a word");
  CHECK(message_of(accents) == "name: got " + accents.substr(0, 76) + "..., allowed: a word");
}
