add_gtest(test_progress unit scene)
add_gtest(test_record unit scene VTK::IOXML)
add_gtest(test_scene unit scene)
